"""The server, the page in a headless Chromium while a race goes on, and the text."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path

import pytest
from browser import asked_for, browser, needs_browser, said
from places import ROOT
from studies import fill, plan_of, write_spec

from sweeps.cli import main as cli
from sweeps.watch.server import Watcher

EVIL = "<img src=x onerror=alert(1)>&amp;"
SPEC = """\
schema = 1
seed = 7
episodes_per_cell = 4
objects = ["block", "wedge", "funnel"]
""" + "".join(f"""[[strategy]]
name = "{name}"
waypoints = {{ kind = "ring", count = 6 }}
""" for name in ("ant", "bee", "horse", EVIL))


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Watcher]:
    fill(tmp_path / "out", plan_of(tmp_path / "spec", SPEC))
    with Watcher(tmp_path / "out", 0, "chamfer_mm") as found:
        threading.Thread(target=found.serve_forever, daemon=True).start()
        yield found
        found.shutdown()


def ask(server: Watcher, path: str, method: str = "GET", **headers: str) -> tuple[int, str]:
    connection = HTTPConnection("127.0.0.1", server.server_address[1], timeout=10)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def test_it_answers_two_paths_on_the_loopback(server: Watcher) -> None:
    assert server.server_address[0] == "127.0.0.1"
    code, page = ask(server, "/")
    assert code == 200
    assert "<h1" in page
    assert not re.search(r"(src|href)\s*=|https?://(?!www\.w3\.org/2000/svg)|@import|url\(", page)
    code, text = ask(server, "/state.json?seen=")
    state = json.loads(text)
    assert code == 200
    assert {row["label"] for row in state["rows"]} == {"ant", "bee", "horse", EVIL}
    assert ask(server, f"/state.json?seen={state['version']}") == (204, "")
    assert ask(server, "/../../etc/passwd")[0] == 404
    assert ask(server, "/", method="POST")[0] == 501


def test_a_page_left_open_is_shown_what_is_watched_next(server: Watcher, tmp_path: Path) -> None:
    """Its first state on the same port was taken for the last one of the study before."""
    seen = json.loads(ask(server, "/state.json")[1])["version"]
    fill(tmp_path / "next", plan_of(tmp_path / "other", SPEC.replace("seed = 7", "seed = 8")))
    with Watcher(tmp_path / "next", 0, "chamfer_mm") as later:
        assert later.state_after(str(seen)) is not None


def test_pages_of_other_sites_get_nothing(server: Watcher) -> None:
    for host in ("evil.example", "evil.example:80", f"evil.example:{server.server_address[1]}"):
        assert ask(server, "/state.json", Host=host)[0] == 403


def test_a_taken_port_is_an_error(server: Watcher, tmp_path: Path,
                                  capsys: pytest.CaptureFixture[str]) -> None:
    port = server.server_address[1]
    assert cli.run(["watch", str(tmp_path / "out"), "--port", str(port)]) == 2
    assert f"--port: {port} cannot be used" in capsys.readouterr().err
    assert cli.run(["watch", str(tmp_path / "out"), "--port", "70000"]) == 2
    assert cli.run(["watch", str(tmp_path / "none")]) == 2
    assert "holds no study" in capsys.readouterr().err


def test_as_text(server: Watcher, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["watch", str(tmp_path / "out"), "--terminal"]) == 0
    printed = capsys.readouterr().out
    assert "state: finished  units: 12 of 12" in printed
    assert EVIL in printed
    assert "\033" not in printed
    assert cli.run(["watch", str(tmp_path / "out"), "--terminal", "--metric", "nothing"]) == 2


RUN = ("import sys; from sweeps.run import worker; from sweeps.cli import main as cli; "
       "worker.EPISODES = 'fake_episodes:slow_episodes'; cli.main(sys.argv[1:])")
# A shell started in the background ignores SIGINT, and so does what it starts.
# It looks once a second, however long that takes.
WATCH = ("import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
         "from sweeps.cli import main as cli; from sweeps.watch import view; view.SHARE = 1.0; "
         "cli.main(sys.argv[1:])")


@needs_browser
def test_a_race_is_watched_in_a_browser(tmp_path: Path) -> None:
    """A page that is open while the race goes on shows its rungs, then that it was stopped."""
    spec, out = write_spec(tmp_path, SPEC), tmp_path / "out"
    environment = {**os.environ, "FAKE_SECONDS": "0.03",
                   "PYTHONPATH": f"{ROOT}:{ROOT / 'tests/helpers'}"}
    race = subprocess.Popen(
        [sys.executable, "-c", RUN, "race", str(spec), "-o", str(out), "--within", "0.0001"],
        cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (out / "logs" / "race.json").exists():
        time.sleep(0.05)
    watch = subprocess.Popen([sys.executable, "-c", WATCH, "watch", str(out)], cwd=ROOT,
                             env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                             text=True)
    try:
        assert watch.stdout is not None
        address = watch.stdout.readline().strip()
        with browser(loopback=True) as driver:
            driver.get(address)
            text = text_when(driver, "race, running", "is being run")
            for _ in range(900):
                if len(driver.find_elements("css selector", "#survivors circle")) >= 3:
                    break
                time.sleep(0.1)
            race.kill()
            race.wait(60)
            text_when(driver, "stopped before it was decided")
            asked, console = asked_for(driver), said(driver)
            labels = [cell.text for cell in driver.find_elements(
                "css selector", "#rows th[scope=row]")]
            dots = driver.find_elements("css selector", "#survivors circle")
    finally:
        race.kill()
        watch.send_signal(signal.SIGINT)
        watch.communicate(timeout=10)
    assert watch.returncode == 0
    assert "Leaderboard" in text
    assert set(labels) == {"ant", "bee", "horse", EVIL}
    assert len(dots) >= 3
    assert console == []
    assert all(url.startswith(address) for url in asked)


def text_when(driver: object, *wanted: str) -> str:
    """The page's text once it holds what is wanted."""
    for _ in range(900):
        text = driver.find_element("css selector", "body").text  # type: ignore[attr-defined]
        if all(part in text for part in wanted):
            return text
        time.sleep(0.1)
    raise AssertionError(f"no {wanted!r} in {text!r}")
