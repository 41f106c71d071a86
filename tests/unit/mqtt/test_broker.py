"""The broker's file: what it may say, and what is refused before anything is sent."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate.mqtt.broker import PASSWORD_VARIABLE, Broker, read_broker

SECRET = {PASSWORD_VARIABLE: "sesame"}


def written(folder: Path, text: str, *, mode: int = 0o600) -> Path:
    file = folder / "broker.toml"
    file.write_text(text)
    file.chmod(mode)
    return file


def test_a_broker_is_encrypted_unless_its_file_says_otherwise(tmp_path: Path) -> None:
    file = written(tmp_path, 'host = "hall"\ntopic = "palpate/line-1"')
    broker = read_broker(file, environment=SECRET)
    assert broker == Broker(host="hall", topic="palpate/line-1", password="sesame")
    assert broker.port_or_usual == 8883
    plain = written(tmp_path, 'host = "localhost"\ntopic = "palpate"\ntls = false')
    assert read_broker(plain, environment={}).port_or_usual == 1883


def test_its_files_are_beside_it(tmp_path: Path) -> None:
    (tmp_path / "ca.pem").touch()
    file = written(tmp_path, 'host = "hall"\ntopic = "palpate"\nca = "ca.pem"')
    assert read_broker(file, environment={}).ca == str(tmp_path / "ca.pem")


@pytest.mark.parametrize(
    ("text", "mode", "why"),
    [
        ("host = ", 0o600, "Invalid value"),
        ('host = "hall"', 0o600, "lacks topic"),
        ('host = "hall"\ntopic = "a"\nporte = 1', 0o600, "has porte, which is not known"),
        ('host = "hall"\ntopic = "a"\nport = "many"', 0o600, "port is 'many', not a count"),
        ('host = ""\ntopic = "a"', 0o600, "host '' is no name or address"),
        ('host = " "\ntopic = "a"', 0o600, "host ' ' is no name or address"),
        ('host = "hall..3"\ntopic = "a"', 0o600, "host 'hall..3' is no name or address"),
        ('host = "hall"\ntopic = "a"\nport = 70000', 0o600, "port 70000 is not 1 to 65535"),
        ('host = "hall"\ntopic = "a"\nport = 0', 0o600, "port 0 is not 1 to 65535"),
        ('host = "hall"\ntopic = "a/#"', 0o600, "topic 'a/#' can't be published to"),
        ('host = "hall"\ntopic = "a"\npassword = "x"', 0o644, "others can read its password"),
        ('host = "hall"\ntopic = "a"\ntls = false', 0o600, "a password needs TLS"),
        ('host = "hall"\ntopic = "a"\nca = "none.pem"', 0o600, "there is no file"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(
    tmp_path: Path, text: str, mode: int, why: str
) -> None:
    file = written(tmp_path, text, mode=mode)
    with pytest.raises(InputError, match=f"--mqtt {file}: .*{why}") as refused:
        read_broker(file, environment=SECRET)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.toml: No such file"):
        read_broker(tmp_path / "none.toml")
