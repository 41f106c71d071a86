"""Recordings of the twin, and archives of them or of drawn holds."""

from __future__ import annotations

import gc
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
from moto.server import ThreadedMotoServer
from packages.archive.tests.drawn import palpate
from s3fs import S3FileSystem

from palpate_archive.adding import add_recordings
from palpate_archive.layout import open_archive


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record two simulated grasps, with a store."""
    folder = tmp_path_factory.mktemp("recorded")
    for number, seed in enumerate((0, 1), start=1):
        status = palpate(
            *("grasp", "--rig", "sim-rigid", "--rate-hz", "15", "--method", "paper"),
            *("--seed", str(seed), "--object", "strawberry"),
            *("--record", str(folder / f"g{number}.mcap"), "--item", f"berry-{number}"),
            *("--store", str(folder / "items.sqlite")),
        )
        assert status == 0
    return folder


@pytest.fixture(scope="session")
def filled(tmp_path_factory: pytest.TempPathFactory, recorded: Path) -> Path:
    """Return an archive of both recordings; one of them is given twice."""
    root = tmp_path_factory.mktemp("filled") / "archive"
    copy = root.parent / "copy.mcap"
    shutil.copy(recorded / "g1.mcap", copy)
    given = [recorded / "g1.mcap", copy, recorded / "g2.mcap"]
    first, repeated, second = add_recordings(
        open_archive(root, create=True), given, station="north"
    )
    assert min(first["frames"], second["frames"]) > 0
    assert repeated == {}, "recordings are identified by content"
    return root


@pytest.fixture
def root(filled: Path, tmp_path: Path) -> Path:
    """Return the folder of an archive of two recordings."""
    return Path(shutil.copytree(filled, tmp_path / "archive"))


@pytest.fixture(autouse=True, scope="module")
def _collect_connections() -> Iterator[None]:
    """Collect the connections that the libraries of schedulers and stores leave to the collector.

    Otherwise their warnings appear in a later test.
    """
    yield
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


@pytest.fixture(scope="session")
def s3_server() -> Iterator[str]:
    """Start an S3 server in this process; return its address."""
    server = ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    # Connections are kept for later calls, also those of workers in threads.
    for fs in list(S3FileSystem._cache.values()):
        S3FileSystem.close_session(fs.loop, fs._s3)
    S3FileSystem.clear_instance_cache()
    server.stop()


@pytest.fixture
def bucket(s3_server: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> str:
    """Return the address of a new bucket."""
    monkeypatch.setenv("AWS_ENDPOINT_URL", s3_server)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    name = request.node.name.split("[")[0].replace("_", "-")[:60]
    S3FileSystem().mkdir(name)
    return f"s3://{name}"
