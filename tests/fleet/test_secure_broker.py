"""A broker as `docs/how-to/fleet-classroom.md` sets it up: TLS, passwords or certificates, an access list."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import processes
from tests.fleet.access_list import PASSWD, page_lists
from tests.fleet.mosquitto import Broker, needs_broker

pytestmark = [
    *needs_broker,
    pytest.mark.slow,
    pytest.mark.usefixtures("user"),
    pytest.mark.skipif(not PASSWD or not shutil.which("openssl"), reason="needs mosquitto_passwd and openssl"),
]

KEY = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]


def certificate(folder: Path, name: str, extension: str) -> None:
    """Make `NAME.crt` and `NAME.key`, signed by the authority in the same folder."""
    (folder / "extension").write_text(f"authorityKeyIdentifier=keyid\n{extension}\n", encoding="utf-8")
    openssl(folder, "req", *KEY, "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.csr")
    signing = ["-CA", "ca.crt", "-CAkey", "ca.key", "-CAcreateserial", "-days", "30", "-extfile", "extension"]
    openssl(folder, "x509", "-req", "-in", f"{name}.csr", *signing, "-out", f"{name}.crt")


def openssl(folder: Path, *arguments: str) -> None:
    processes.run(["openssl", *arguments], check=True, cwd=folder)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with an authority, a certificate of the broker, passwords and an access list."""
    usage = ["-addext", "keyUsage=critical,keyCertSign,cRLSign"]
    days = ["-days", "30", "-subj", "/CN=Classroom"]
    openssl(tmp_path, "req", "-x509", *KEY, *days, *usage, "-keyout", "ca.key", "-out", "ca.crt")
    certificate(tmp_path, "broker", "subjectAltName=DNS:localhost,IP:127.0.0.1")
    for user in ("teacher", "robot01"):
        secret = tmp_path / f"{user}.password"
        secret.touch(0o600)
        secret.write_text(f"secret of {user}\n", encoding="utf-8")
    hashed = tmp_path / "passwords"
    hashed.write_text("teacher:secret of teacher\nrobot01:secret of robot01\n", encoding="utf-8")
    processes.run([str(PASSWD), "-U", str(hashed)], check=True)
    (tmp_path / "access").write_text(page_lists()[0], encoding="utf-8")
    return tmp_path


def command(folder: Path, broker: Broker, user: str, *words: str) -> list[str]:
    """Return a command of `servolink fleet` for a user with a password."""
    secret = ["--user", user, "--password-file", str(folder / f"{user}.password")]
    url = f"mqtts://127.0.0.1:{broker.port}"
    place = [url, "virtual://?servos=2"] if words[0] == "join" else ["--broker", url]
    return [sys.executable, "-m", "servolink", "fleet", *words, *place, "--ca", str(folder / "ca.crt"), *secret]


def join(command: list[str]) -> Callable[[], str]:
    """Join, and return what ends it and returns what it said."""
    program = processes.start(command)
    assert program.stdout is not None
    line = program.stdout.readline()
    assert line.startswith("joined "), processes.finish(program)

    def end() -> str:
        _, said = processes.finish(program, signal.SIGINT)
        assert program.returncode == 0
        return said

    return end


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    return processes.run(command)


def test_a_broker_with_passwords(folder: Path) -> None:
    listener = [f"certfile {folder}/broker.crt", f"keyfile {folder}/broker.key"]
    lines = ["allow_anonymous false", f"password_file {folder}/passwords", f"acl_file {folder}/access"]
    broker = Broker(folder, lines, listener)
    broker.start()
    end = join(command(folder, broker, "robot01", "join", "--name", "robot01"))
    listed = run(command(folder, broker, "teacher", "list"))
    assert listed.stdout.splitlines()[1].split()[:2] == ["robot01", "ready"]
    assert "stopped 1 board" in run(command(folder, broker, "teacher", "stop")).stdout
    assert end() == "ended: the boards were left unchanged\n"

    denied = run(command(folder, broker, "robot01", "join", "--name", "robot02"))  # which is somebody else's
    assert (denied.returncode, denied.stdout) == (3, "")
    assert "robot02 has not joined: the broker does not allow writing to servolink/robot02/available" in denied.stderr

    (folder / "robot01.password").write_text("guessed\n", encoding="utf-8")
    refused = run(command(folder, broker, "robot01", "join"))
    assert refused.returncode == 3
    assert "the broker does not let this program in: correct user and password" in refused.stderr
    unknown = command(folder, broker, "teacher", "list")
    unknown[unknown.index("--ca") + 1] = str(folder / "other.crt")
    openssl(folder, "req", "-x509", *KEY, "-subj", "/CN=Other", "-keyout", "other.key", "-out", "other.crt")
    assert "certificate is not trusted" in run(unknown).stderr


def test_a_broker_with_certificates(folder: Path) -> None:
    certificate(folder, "robot01", "extendedKeyUsage=clientAuth")
    listener = [
        *(f"certfile {folder}/broker.crt", f"keyfile {folder}/broker.key", f"cafile {folder}/ca.crt"),
        *("require_certificate true", "use_identity_as_username true"),
    ]
    broker = Broker(folder, [f"acl_file {folder}/access"], listener)
    broker.start()
    join_command = [sys.executable, "-m", "servolink", "fleet", "join", f"mqtts://127.0.0.1:{broker.port}"]
    join_command += ["virtual://?servos=2", "--name", "robot01", "--ca", str(folder / "ca.crt")]
    refused = run(join_command)
    assert refused.returncode == 3
    own = ["--certificate", str(folder / "robot01.crt"), "--key", str(folder / "robot01.key")]
    assert join([*join_command, *own])() == "ended: the boards were left unchanged\n"
