"""Reading the broker file: accepted values and refusals."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate_station.mqtt.broker import PASSWORD_VARIABLE, Broker, read_broker

SECRET = {PASSWORD_VARIABLE: "sesame"}


def write_broker_file(folder: Path, text: str, *, mode: int = 0o600) -> Path:
    file = folder / "broker.toml"
    file.write_text(text)
    file.chmod(mode)
    return file


def test_read_broker_uses_tls_unless_the_file_disables_it(tmp_path: Path) -> None:
    file = write_broker_file(tmp_path, 'host = "hall"\ntopic = "palpate/line-1"')
    broker = read_broker(file, environment=SECRET)
    assert broker == Broker(host="hall", topic="palpate/line-1", password="sesame")
    assert broker.effective_port == 8883
    plain = write_broker_file(tmp_path, 'host = "localhost"\ntopic = "palpate"\ntls = false')
    assert read_broker(plain, environment={}).effective_port == 1883


def test_read_broker_resolves_certificate_paths_relative_to_its_folder(tmp_path: Path) -> None:
    (tmp_path / "ca.pem").touch()
    file = write_broker_file(tmp_path, 'host = "hall"\ntopic = "palpate"\nca = "ca.pem"')
    assert read_broker(file, environment={}).ca == str(tmp_path / "ca.pem")


@pytest.mark.parametrize(
    ("text", "mode", "why"),
    [
        ("host = ", 0o600, "Invalid value"),
        ('host = "hall"', 0o600, "the file lacks topic$"),
        ('host = "hall"\ntopic = "a"\nporte = 1', 0o600, "has unknown keys: porte"),
        ('host = "hall"\ntopic = "a"\nport = "many"', 0o600, "port is 'many', not a count"),
        ('host = "hall"\ntopic = "a"\ntls = "no"', 0o600, "tls is 'no', not true or false"),
        ('host = ""\ntopic = "a"', 0o600, "host '' is not a valid host name or IP address"),
        (
            'host = "hall"\ntopic = "a"\nport = 70000',
            0o600,
            "port 70000 is not between 1 and 65535",
        ),
        *(
            (f'host = "{host}"\ntopic = "a"', 0o600, "write the name alone")
            for host in (
                "mqtt://h",
                "h:1883",
                "user@h",
                "[::1]",
                "10.0.0.300",
                "a.b..",
                "x" * 64,
                "a." * 130 + "a",
            )
        ),
        *(
            (f'host = "h"\ntopic = "{topic}"', 0o600, "topic")
            for topic in ("é" * 600, "a/+/b", "a\\u0000b", "a\\nb", "")
        ),
        (f'host = "h"\ntopic = "a"\nusername = "{"u" * 70_000}"', 0o600, "username has 70000"),
        ('host = "h"\ntopic = "a"\nkey = "k.pem"', 0o600, "key needs `certificate`"),
        ("[" * 100_000, 0o600, ""),
        ('host = "hall"\ntopic = "a"\npassword = "x"', 0o644, "other users can read the password"),
        ('host = "hall"\ntopic = "a"\ntls = false', 0o600, "to hall requires TLS"),
        ('host = "hall"\ntopic = "a"\nca = "none.pem"', 0o600, "does not exist"),
    ],
)
def test_read_broker_with_an_invalid_file_raises_a_one_line_error(
    tmp_path: Path, text: str, mode: int, why: str
) -> None:
    file = write_broker_file(tmp_path, text, mode=mode)
    with pytest.raises(InputError, match=f"--mqtt {file}: .*{why}") as refused:
        read_broker(file, environment=SECRET)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "host", ["hall", "line_3.plant.local", "10.0.0.3", "::1", "fe80::1%eth0", "bröker.de", "h."]
)
def test_read_broker_accepts_names_and_addresses(tmp_path: Path, host: str) -> None:
    file = write_broker_file(tmp_path, f'host = "{host}"\ntopic = "werk/größe-1"')
    assert read_broker(file, environment={}).host == host


def test_read_broker_of_a_binary_or_missing_file_names_it_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "broker.toml").write_bytes(b"\xff\xfe\0host")
    for name, why in (("broker.toml", ""), ("none.toml", "No such file")):
        with pytest.raises(InputError, match=rf"--mqtt .*{name}: {why}") as refused:
            read_broker(tmp_path / name)
        assert "\n" not in str(refused.value)
