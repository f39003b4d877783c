"""A headless Chromium that may talk to nobody, and notes whatever it tries."""

import atexit
import base64
import io
import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
import pytest
from PIL import Image

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver") or shutil.which("chromium-driver")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         "--disable-dev-shm-usage", "--window-size=1280,900")
NOBODY = "--host-resolver-rules=MAP * ~NOTFOUND"

needs_browser = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="needs Debian's chromium and chromium-driver: "
    "apt-get install chromium chromium-driver")


@contextmanager
def browser(loopback: bool = False) -> Iterator[Any]:
    """A driver with an empty page, what its console says and asks for recorded from here on; it may
    talk to servers of this machine if `loopback`. The browser behind it is started once."""
    driver = _started(loopback)
    first = driver.current_window_handle
    empty = driver.execute_cdp_cmd("Target.createTarget", {"url": "about:blank"})
    driver.switch_to.window(empty["targetId"])
    driver.get("about:blank")
    said(driver)
    asked_for(driver)  # what the browser did by itself, before any page of ours
    try:
        yield driver
    finally:
        driver.close()
        driver.switch_to.window(first)


@cache
def _started(loopback: bool) -> Any:
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    profile = tempfile.TemporaryDirectory()
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in (*FLAGS, NOBODY + ", EXCLUDE 127.0.0.1" * loopback,
                 f"--user-data-dir={profile.name}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    driver.set_page_load_timeout(60)
    driver.get("about:blank")  # in place of the browser's own first page
    atexit.register(profile.cleanup)
    atexit.register(driver.quit)  # before the profile goes
    return driver


def said(driver: Any) -> list[str]:
    """What the page wrote to its console since last asked, as the browser shows it."""
    return [entry["message"] for entry in driver.get_log("browser")]


def asked_for(driver: Any) -> list[str]:
    """The addresses that pages asked for since last asked, whatever came of it."""
    messages = [json.loads(entry["message"])["message"]
                for entry in driver.get_log("performance")]
    return [message["params"]["request"]["url"] for message in messages
            if message["method"] == "Network.requestWillBeSent"]


def pixels(driver: Any, canvas: str) -> np.ndarray:
    """The red, green, blue, alpha of a canvas, by its id, shape (pixel, 4)."""
    time.sleep(0.3)  # it is painted before the next frame
    text = driver.execute_script(
        "return document.getElementById(arguments[0]).toDataURL('image/png')", canvas)
    with Image.open(io.BytesIO(base64.b64decode(text.partition(",")[2]))) as image:
        return np.asarray(image.convert("RGBA")).reshape(-1, 4).astype(int)
