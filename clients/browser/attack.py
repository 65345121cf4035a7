"""Pages of other sites beside a coordinator without tokens: they read nothing and change nothing.

Two pages are played: one of another origin, and one whose name was pointed to the coordinator after it was loaded
(DNS rebinding). With the name allowed by the operator the second one gets in, which shows that it does attack.
"""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from service import STUDY, Service
from visitor import launch, say

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Playwright

SECRET = "nobody-elses-study"
REBOUND = "rebind.example"
ELSEWHERE = "elsewhere.example"

# What a page tries. It reports what it could read, and whether anything came for it which is of use.
ATTACK = """async ([target, study]) => {
    const read = [];
    const within = (ms, wait) => Promise.race([wait, new Promise((end) => setTimeout(() => end("silence"), ms))]);
    const body = JSON.stringify({ name: "attack", sampling: { samples: 20 }, model: { kind: "quasi-steady" } });
    const worker = JSON.stringify({ name: "attack", slots: 1, protocol_version: 3, solver_version: "9", level: "x" });
    const paths = ["/v1/studies", `/v1/studies/${study}`, `/v1/studies/${study}/dataset`, "/v1/workers", "/metrics", "/healthz", "/openapi.json", "/"];
    for (const path of paths) {
        for (const mode of ["cors", "no-cors", "same-origin"]) {
            try {
                const answer = await fetch(target + path, { mode });
                const text = await answer.text();
                if (answer.ok && text) read.push(`${mode} ${path}: ${text.slice(0, 300)}`);
            } catch { /* refused by the browser */ }
        }
    }
    const types = ["application/json", "text/plain", "application/toml"];
    const posts = [["/v1/studies", body], ["/v1/workers", worker], [`/v1/studies/${study}/cancel`, ""]];
    for (const [path, content] of posts) {
        for (const mode of ["cors", "no-cors"]) {
            for (const type of types) {
                try {
                    const answer = await fetch(target + path, { method: "POST", mode, body: content, headers: { "content-type": type } });
                    if (answer.ok) read.push(`POST ${path}`);
                } catch { /* refused by the browser */ }
            }
        }
        navigator.sendBeacon(target + path, new Blob([content], { type: "text/plain" }));
        const sink = document.body.appendChild(Object.assign(document.createElement("iframe"), { name: `sink${path}` }));
        const form = document.createElement("form");
        Object.assign(form, { action: target + path, method: "post", enctype: "text/plain", target: sink.name });
        form.append(Object.assign(document.createElement("input"), { name: content.slice(0, -1), value: "}" }));
        document.body.append(form);
        form.submit();
    }
    const loads = (tag, more) => within(4000, new Promise((end) => {
        const element = Object.assign(document.createElement(tag), more);
        element.onload = () => end("load");
        element.onerror = () => end("error");
        document.body.append(element);
    }));
    for (const [tag, more] of [
        ["img", { src: `${target}/assets/icon.svg` }],
        ["script", { src: `${target}/assets/format.js`, type: "module" }],
        ["script", { src: `${target}/docs/start.js` }],
        ["link", { rel: "stylesheet", href: `${target}/assets/style.css` }],
    ]) {
        if (await loads(tag, more) === "load") read.push(`${tag} ${more.src ?? more.href}`);
    }
    for (const path of ["/", "/docs", "/v1/studies"]) await loads("iframe", { src: target + path });
    const events = await within(4000, new Promise((end) => {
        const source = new EventSource(`${target}/v1/events`);
        source.addEventListener("changed", (event) => end(event.data));
        source.onerror = () => { source.close(); end(null); };
    }));
    if (events && events !== "silence") read.push(`events: ${events}`);
    return read;
}"""


class Elsewhere(BaseHTTPRequestHandler):
    """A site with an empty page."""

    def do_GET(self) -> None:
        page = b"<!doctype html><title>elsewhere</title><body>"
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.send_header("content-length", str(len(page)))
        self.end_headers()
        self.wfile.write(page)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


def stored(service: Service) -> object:
    """Give everything an attack could have changed."""
    studies = [(study["id"], study["name"], study["state"]) for study in service.ask("/v1/studies")["items"]]
    return studies, [worker["name"] for worker in service.ask("/v1/workers")]


def frames(page: Page) -> list[str]:
    """Give what the frames of a page show of the coordinator."""
    texts = []
    for frame in page.frames[1:]:
        text = frame.evaluate("document.documentElement?.textContent ?? ''")
        if SECRET in text or "manduca" in text and "urn:manduca:problem" not in text:
            texts.append(f"{frame.url}: {text[:120]}")
    return texts


def attack(browser: Browser, origin: str, target: str, study: str, *, rebound: bool = False) -> list[str]:
    """Let the page of an origin attack; give what it read."""
    context = browser.new_context()
    page = context.new_page()
    if rebound:
        # The name still leads elsewhere when the page is loaded; the next request finds the coordinator.
        page.route(f"{origin}/trap", lambda route: route.fulfill(content_type="text/html", body="<!doctype html><body>"))
        page.goto(f"{origin}/trap")
    else:
        page.goto(origin)
    assert page.evaluate("origin") == origin
    read = page.evaluate(ATTACK, [target, study])
    page.wait_for_timeout(500)
    read += frames(page)
    context.close()
    return read


def beside(browser: Browser, service: Service, elsewhere: int) -> dict[str, list[str]]:
    """Attack a coordinator from everywhere; give what was read, by attacker."""
    port = urlsplit(service.url).port
    study = service.ask("/v1/studies")["items"][0]["id"]
    found = {}
    for target in (f"http://127.0.0.1:{port}", f"http://localhost:{port}", f"http://{REBOUND}:{port}"):
        for origin in (f"http://{ELSEWHERE}:{elsewhere}", f"http://127.0.0.1:{elsewhere}", f"http://localhost:{elsewhere}"):
            found[f"{origin} at {target}"] = attack(browser, origin, target, study)
    rebound = f"http://{REBOUND}:{port}"
    found["rebound"] = attack(browser, rebound, rebound, study, rebound=True)
    return found


def prepared(*arguments: str) -> Service:
    service = Service(None, *arguments)
    service.submit(STUDY.replace('"browser"', f'"{SECRET}"').replace("samples = 60", "samples = 100000"))
    return service


def check(playwright: Playwright) -> None:
    """Attack a coordinator, and one which takes the attacker's name for its own."""
    site = ThreadingHTTPServer(("127.0.0.1", 0), Elsewhere)
    threading.Thread(target=site.serve_forever, daemon=True).start()
    rules = f"MAP {REBOUND} 127.0.0.1, MAP {ELSEWHERE} 127.0.0.1"
    # Nothing of the browser's own may stand in for the coordinator's refusals.
    off = "LocalNetworkAccessChecks,BlockInsecurePrivateNetworkRequests,HttpsUpgrades,HttpsFirstBalancedModeAutoEnable"
    browser = launch(playwright, f"--host-resolver-rules={rules}", f"--disable-features={off}")
    service = prepared()
    try:
        before = stored(service)
        found = beside(browser, service, site.server_port)
        assert not any(found.values()), json.dumps(found, indent=1)
        assert stored(service) == before, (before, stored(service))
    finally:
        service.stop()
    service = prepared("--allow-host", REBOUND)
    try:
        origin = f"http://{REBOUND}:{urlsplit(service.url).port}"
        study = service.ask("/v1/studies")["items"][0]["id"]
        read = attack(browser, origin, origin, study, rebound=True)
        assert any(SECRET in text for text in read), f"the attack itself does not work: {read}"
        states = {id_: state for id_, _, state in stored(service)[0]}
        assert states[study] == "cancelled", states
    finally:
        service.stop()
        browser.close()
        site.shutdown()
    say("pages of other sites read nothing and changed nothing")
