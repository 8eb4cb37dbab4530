"""Chromium without a screen, spoken to through a pipe in its DevTools protocol: for times, which need a clock that runs."""

import json
import os
import subprocess
import time


class Browser:
    """Started by `with`, ended with it."""

    def __init__(self, program, folder):
        self.command = [program, "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        self.command += [f"--user-data-dir={folder / 'profile'}", "--window-size=1200,900", "--remote-debugging-pipe"]
        self.asked = 0

    def __enter__(self):
        # The browser reads its file 3 and writes its file 4.
        (reads, self.to), (self.answers, writes) = os.pipe(), os.pipe()
        pipe = f"exec 3<&{reads} 4>&{writes}; exec \"$@\""
        self.process = subprocess.Popen(
            ["bash", "-c", pipe, "bash", *self.command], pass_fds=(reads, writes), stderr=subprocess.DEVNULL
        )
        os.close(reads)
        os.close(writes)
        self.answers = os.fdopen(self.answers, "rb")
        self.rest = b""
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(20)

    def ask(self, method, session=None, **parameters):
        """Calls a method and waits for its answer."""
        self.asked += 1
        call = {"id": self.asked, "method": method, "params": parameters} | ({"sessionId": session} if session else {})
        os.write(self.to, json.dumps(call).encode() + b"\0")
        while True:
            while b"\0" not in self.rest:
                more = self.answers.read1(1 << 20)
                assert more, "the browser ended"
                self.rest += more
            message, self.rest = self.rest.split(b"\0", 1)
            answer = json.loads(message)
            if answer.get("id") == self.asked:
                assert "error" not in answer, answer
                return answer["result"]

    def open(self, address):
        self.ask("Page.navigate", self.session, url=address)

    def time_until(self, address, condition, seconds=30):
        """Seconds from the address to the first moment at which an expression of JavaScript is true."""
        start = time.monotonic()
        self.open(address)
        while time.monotonic() < start + seconds:
            # Of the page before, nothing is asked.
            there = f"location.href === {json.dumps(address)} && ({condition})"
            found = self.ask("Runtime.evaluate", self.session, expression=there)["result"]
            if found.get("value") is True:
                return time.monotonic() - start
            time.sleep(0.02)
        raise TimeoutError(f"{condition} was not true within {seconds} s")
