"""The page as a visitor sees it, in a browser that reaches this machine alone."""

import json
import shutil
import threading
import urllib.request
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from served import served, until, upload

REBOUND = "elsewhere.test"
"""A name that a page of others has pointed at this machine."""
programs = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
pytestmark = [
    pytest.mark.end_to_end,
    pytest.mark.skipif(None in programs.values(), reason="no Chromium with its driver"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of the driver's sockets
]


@pytest.fixture(scope="module")
def address(tiny_checkpoint: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tiny_checkpoint, tmp_path_factory.mktemp("served")) as address:
        yield address


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = str(programs["chromium"])
    nowhere = f"--host-resolver-rules=MAP {REBOUND} 127.0.0.1, MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"
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


def body(browser: Any) -> str:
    return str(browser.find_element("css selector", "body").text)


def test_nothing_that_was_uploaded_runs(browser: Any, address: str, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("<script>document.title = 'it ran'; document.body.innerHTML = 'it ran'</script>")
    for name in ("page.html", "page.svg", "page.xml", "page.png"):
        path = upload(address, name, page.read_bytes())
        browser.get("about:blank")
        browser.get(f"{address}/gradio_api/file={path}")
        assert browser.title != "it ran"
        assert "it ran" not in body(browser)


def test_a_name_that_was_pointed_here_shows_nothing(browser: Any, address: str) -> None:
    browser.get(address.replace("127.0.0.1", REBOUND))
    assert "refused: this page is of this machine alone" in body(browser)


def test_a_page_of_others_posts_nothing(browser: Any, address: str, tmp_path: Path) -> None:
    script = f"""<script>
        const form = new FormData(); form.append("files", new File(["posted"], "posted.txt"));
        const upload = "{address}/gradio_api/upload";
        const asked = [fetch("{address}/config", {{mode: "no-cors"}})];
        asked.push(fetch(upload, {{method: "POST", mode: "no-cors", body: form}}));
        asked.push(fetch(upload, {{method: "POST", body: form}}).then(one => one.text()));
        Promise.allSettled(asked).then(ended => document.title = `all ended: ${{ended.at(-1).value}}`);
        </script>"""

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(script.encode())

        def log_message(self, *said: object) -> None:
            pass

    folder = Path(upload(address, "mine.txt", b"mine")).parents[1]
    with ThreadingHTTPServer(("127.0.0.1", 0), Page) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        browser.get(f"http://127.0.0.1:{other.server_port}")
        title = until(lambda: browser.title)
        other.shutdown()
    assert title == "all ended: refused: a page of another address asks"
    assert [path.name for path in folder.rglob("*.txt")] == ["mine.txt"]
