"""The running server: who may ask, for what; uploads; logs that cannot be read, and columns, in a browser."""

import http.client
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from app.conftest import App, Tab, start_app
from stoop_app.folder import MAPPING, Project

Answer = tuple[int, dict[str, str], bytes]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    one = start_app(tmp_path_factory.mktemp("gate") / "project", "--max-upload", "2")
    yield one
    one.kill()


def ask(app: App, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> Answer:
    connection = http.client.HTTPConnection("127.0.0.1", app.port)
    connection.request(method, path, body=body, headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


def test_who_and_what_is_refused(running: App) -> None:
    port, own = running.port, f"/{running.token}"
    assert len(running.token) >= 32
    status, headers, page = ask(running, f"{own}/")
    assert status == 200
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert set(re.findall(rb"http://[\w.]+", page)) <= {b"http://127.0.0.1", b"http://www.w3.org"}
    # without the secret, or with another: pages, scripts, websockets, files, uploads
    wrong = f"/{'A' * len(running.token)}"
    for place in ("/", "", "/ws", "/static/js/bokeh.min.js", "/autoload.js", "/files/app.toml", "/upload"):
        for start in ("", wrong, f"{own[:-1]}", f"/x{own}"):
            assert ask(running, f"{start}{place}")[0] == 403, (start, place)
    evil = {"Origin": "http://evil.example"}
    upgrade = {
        "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "AAAA",
    }  # fmt: skip
    for place, method, more, code in (
        (f"{wrong}/upload?name=x", "POST", {}, 403), ("*", "OPTIONS", {}, 403), (f"{own}/", "GET", evil, 403),
        (f"{own}/upload?name=x", "POST", evil, 403), (f"{own}/", "GET", {"Host": f"evil.example:{port}"}, 403),
        (f"{own}/", "GET", {"Origin": f"http://127.0.0.1:{port}"}, 200), (f"{own}/ws", "GET", evil | upgrade, 403),
    ):  # fmt: skip
        assert ask(running, place, method, **more)[0] == code, (place, more)
    (running.folder / "a.html").write_text("<script>1</script>")
    (running.folder / "a.svg").write_text("<svg/>")
    (running.folder.parent / "secret.txt").write_text("secret")
    (running.folder / "link.txt").symlink_to(running.folder.parent / "secret.txt")
    status, headers, _ = ask(running, f"{own}/files/a.html")
    assert status == 200
    assert headers["Content-Security-Policy"].startswith("sandbox allow-scripts")
    assert ask(running, f"{own}/files/a.svg")[1]["Content-Disposition"] == "attachment"
    for place in ("../secret.txt", "..%2fsecret.txt", "%2e%2e/secret.txt", "/etc/passwd", "link.txt", ""):
        status, _, body = ask(running, f"{own}/files/{place}")
        assert status in (400, 403, 404), place
        assert body != b"secret"
    for at in ("files/a%00b", "files/%ff%fe", "files/" + "a" * 5000, "upload//?name=x", "upload?name=%ff%fe"):
        for method, content in (("GET", None), ("POST", b"abc")):
            assert ask(running, f"{own}/{at}", method, content)[0] == 400, at


def test_uploads_stay_in_the_folder_and_replace_none(running: App) -> None:
    before = set(running.folder.parent.rglob("*"))

    def sent(query: str, body: bytes) -> tuple[int, str]:
        status, _, said = ask(running, f"/{running.token}/upload?{query}", "POST", body)
        return status, said.decode()

    for name in ("../../x.ulg", "/etc/x.ulg", "..", ".hidden", "a%00b", "con\\x.ulg", "n" * 3000):
        status, said = sent(f"name={name}&into=../..", b"abc")
        assert status == 200, (name, said)
    kept = set(running.folder.parent.rglob("*")) - before
    assert all(p.is_relative_to(running.folder / "logs") for p in kept)
    assert not any(p.name.startswith(".") for p in kept)
    names = [sent("name=same.ulg", body)[1] for body in (b"one", b"one", b"two")]
    assert names == ["logs/same.ulg", "logs/same.ulg", "logs/1-same.ulg"]
    assert (running.folder / "logs" / "same.ulg").read_bytes() == b"one"
    assert sent("name=t.csv&into=tables", b"one") == (200, "logs/tables")
    status, why = sent("name=t.csv&into=tables", b"two")
    assert (status, "rename the folder" in why) == (409, True)
    (running.folder / "logs" / "linked").symlink_to(running.folder.parent)
    assert sent("name=x.csv&into=linked", b"abc")[0] == 507
    assert not (running.folder.parent / "x.csv").exists()
    assert not list(running.folder.rglob(".part-*"))


def test_a_large_log_is_refused_before_it_is_sent(running: App) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", running.port)
    connection.putrequest("POST", f"/{running.token}/upload?name=large.ulg")
    connection.putheader("Content-Length", str(4 * 10**9))
    connection.endheaders()
    answer = connection.getresponse()
    assert (answer.status, answer.read()[:24]) == (413, b"the log holds 4 GB, more")
    connection.close()
    own = f"/{running.token}/upload?size="  # a browser asks before it sends
    assert [ask(running, f"{own}{size}")[0] for size in (4 * 10**9, "9" * 3000, 1000)] == [413, 413, 200]
    assert not list(running.folder.rglob("large*"))


def test_a_port_in_use(running: App, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        words = ["-m", "stoop", "app", "--folder", str(tmp_path / "p"), "--no-browser", "--port", str(port)]
        done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == f"stoop: error: app: port {port} is in use; give another with --port N\n"


def test_logs_that_cannot_be_read(running: App, tab: Callable[[App], Tab], tmp_path: Path) -> None:
    bad, large = tmp_path / "<img src=x onerror=alert(1)>.ulg", tmp_path / "large.ulg"
    bad.write_bytes(b"junk" * 100)
    with large.open("wb") as file:  # sparse: the disk holds none of the zeros
        file.write(b"ULog\x01\x12\x35\x01" + bytes(8))
        file.truncate(2_100_000_000)
    page, label = tab(running), "or the path of a log on this machine"

    def opened(path: Path, said: str) -> None:
        page.fill(label, str(path))
        page.click("Open")
        page.wait(said)

    opened(tmp_path / "none.ulg", "there is no such log")
    page.page.locator("input[type=file]").first.set_input_files(large)
    page.wait("the log holds 2.1 GB, more than the limit of 2 GB; give its path instead")
    assert not list(running.folder.rglob("large*"))
    opened(large, "no topic holds data")
    status = Path(f"/proc/{running.process.pid}/status")
    if status.exists():
        peak = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        assert int(peak.split()[1]) < 1_000_000, "kB; a log is read by another process, and sent in pieces"
    opened(bad, "its first bytes are wrong")
    page.wait("<img src=x onerror=alert(1)>.ulg")
    assert page.page.locator("img").count() == 0
    # A table needs a mapping, whose unsure lines are asked.
    time, log = np.arange(0.0, 20.0, 0.02), tmp_path / "t.csv"
    rows = np.column_stack([time, np.sin(time), 20.0 + np.cos(time), 9.8 + 0.0 * time])
    np.savetxt(log, rows, delimiter=",", header="time_s,roll_rate,airspeed,accel_z", comments="")
    page.fill(label, str(log))
    page.click("Open")
    page.click("Next: the columns")
    page.wait("0 without a variable, 2 unsure")
    page.page.locator('.tabulator-cell[tabulator-field="unit"]').get_by_text("m/s", exact=True).first.click()
    page.page.locator(".tabulator-edit-list-item").get_by_text("kt", exact=True).click()
    page.wait("1 edit not saved")
    page.click("Use these columns")
    page.wait("Next: the vehicle")
    assert 'unit = "kt"' in (running.folder / MAPPING).read_text("utf-8")
    assert Project(running.folder).info["channels"]
    # One that cannot be read leaves it in place, and says so.
    page.click("Another log")
    opened(bad, "was not taken, ")
    page.wait("Next: the vehicle")
    assert Project(running.folder).log == str(log)
    assert 'unit = "kt"' in (running.folder / MAPPING).read_text("utf-8")
