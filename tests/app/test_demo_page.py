"""The page as a visitor sees it, in a browser that reaches this machine alone."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

PROJECT = Path(__file__).parents[2]
SECONDS = 90
programs = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
pytestmark = [
    pytest.mark.skipif(None in programs.values(), reason="no Chromium with its driver"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of the driver's sockets
]


def until(seen: Callable[[], Any]) -> Any:
    """What `seen` returns, as soon as it is something."""
    end = time.monotonic() + SECONDS
    while not (found := seen()):
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.2)
    return found


@pytest.fixture(scope="module")
def address(tiny_checkpoint: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("served")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, str(PROJECT / "app.py"), f"checkpoint={tiny_checkpoint}", f"port={port}"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "TMPDIR": str(folder)}
    with (folder / "log").open("w") as log:
        server = subprocess.Popen(
            [*command, "samples=none"], cwd=folder, env=environment, stdout=log, stderr=subprocess.STDOUT
        )

    def answers() -> bool:
        assert server.poll() is None, (folder / "log").read_text()
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    try:
        until(answers)
        yield f"http://127.0.0.1:{port}"
    finally:
        server.terminate()
        server.wait(SECONDS)
    assert "Traceback" not in (folder / "log").read_text()
    assert not list(folder.glob("col3d-*")), "uploads are left"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = str(programs["chromium"])
    nowhere = "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"
    drawing = ("--enable-unsafe-swiftshader", "--use-angle=swiftshader", "--window-size=1400,1500")
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", *drawing, nowhere):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(str(programs["chromedriver"])))
    yield driver
    driver.quit()


def give(browser: Any, address: str, path: Path) -> None:
    """Open the page anew and upload a file."""
    browser.get(address)
    until(lambda: browser.find_elements("css selector", "#file input[type=file]"))[0].send_keys(str(path))


def picture(browser: Any, name: str) -> str | None:
    """Address of a picture on the page, once it is there."""
    found = browser.find_elements("css selector", f"#{name} img")
    return found[0].get_attribute("src") if found and found[0].is_displayed() else None


def asked_for(browser: Any) -> set[str]:
    """Hosts that the page has asked for anything."""
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    return {url.split("/")[2].partition(":")[0] for url in sent if url.startswith(("http", "ws"))}


def test_an_image_becomes_depth_whose_colours_move(
    browser: Any, address: str, phantom_root: Path, tmp_path: Path
) -> None:
    from selenium.webdriver.common.keys import Keys

    give(browser, address, next((phantom_root / "desc_t4_a").glob("*_color.png")))
    before = until(lambda: picture(browser, "depth"))
    assert picture(browser, "normals")
    assert "depth " in browser.find_element("css selector", "#words .said").text
    slider = browser.find_element("css selector", "#high input[type=range]")
    normals = picture(browser, "normals")
    for _ in range(5):
        slider.send_keys(Keys.ARROW_LEFT)
    until(lambda: picture(browser, "depth") not in (None, before))
    assert picture(browser, "normals") == normals
    until(lambda: browser.find_elements("css selector", "#cloud canvas"))
    assert browser.save_screenshot(str(tmp_path / "page.png"))
    assert "no medical device" in browser.find_element("css selector", "body").text
    assert asked_for(browser) == {"127.0.0.1"}
    assert not browser.execute_script("return document.documentElement.scrollWidth > window.innerWidth")


def test_what_is_no_image_is_refused_in_words(browser: Any, address: str, tmp_path: Path) -> None:
    text = tmp_path / "notes.png"
    text.write_text("no image at all")
    give(browser, address, text)
    refused = until(lambda: browser.find_elements("css selector", "#words .refused"))[0]
    assert refused.text == "notes.png: not an image that can be read"
    assert browser.save_screenshot(str(tmp_path / "refused.png"))
    assert picture(browser, "depth") is None


def test_the_page_speaks_of_no_other_machine(address: str) -> None:
    with urllib.request.urlopen(address) as answer:
        text = answer.read().decode()
    for word in ("fonts.googleapis", "fonts.gstatic", "cdn."):
        assert word not in text
    assert '"analytics_enabled":false' in text.replace(" ", "").replace("False", "false")
