"""A viewer made elsewhere: the Foxglove websocket protocol as its page describes it, and the page in a browser.

Usage: live_client.py foxglove HOST:PORT          prints what came
       live_client.py page HOST:PORT CHROMIUM     prints what the page showed, twice
       live_client.py metrics HOST:PORT           prints what Prometheus' own parser made of /metrics
"""
import asyncio
import base64
import json
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request


def metrics(address):
    from prometheus_client.parser import text_string_to_metric_families

    with urllib.request.urlopen(f"http://{address}/metrics") as answer:
        print("type", answer.headers["Content-Type"])
        text = answer.read().decode()
    for family in text_string_to_metric_families(text):
        print("family", family.name, family.type, len(family.samples), bool(family.documentation))


async def foxglove(address):
    import websockets

    async with websockets.connect(f"ws://{address}", subprotocols=["foxglove.websocket.v1"]) as socket:
        print("subprotocol", socket.subprotocol)
        info = json.loads(await socket.recv())
        print("op", info["op"])
        advertised = json.loads(await socket.recv())
        for channel in advertised["channels"]:
            text = channel["schema"]
            schema = json.dumps(json.loads(text)) if channel["schemaEncoding"] == "jsonschema" else base64.b64decode(text)
            print("channel", channel["topic"], channel["encoding"], channel["schemaName"], channel["schemaEncoding"], len(schema) > 100)
        ids = {channel["topic"]: channel["id"] for channel in advertised["channels"]}
        await socket.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 41, "channelId": ids["/tick"]}]}))
        count, before = 0, 0
        while count < 50:
            message = await asyncio.wait_for(socket.recv(), 10)
            if isinstance(message, str):
                print("status", message)
                continue
            op, subscription, at_ns = struct.unpack("<BIQ", message[:13])
            assert (op, subscription) == (1, 41) and at_ns >= before, (op, subscription, at_ns)
            before, count = at_ns, count + 1
        print("age_below_10_s", abs(time.time() - before / 1e9) < 10)
        print("ticks", count)


async def page(address, chromium):
    import websockets

    # Children of the browser may still write there when it has ended.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        arguments = ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", f"--user-data-dir={profile}", "about:blank"]
        browser = subprocess.Popen([chromium, *arguments], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        try:
            for line in browser.stderr:
                if "DevTools listening on" in line:
                    port = line.rsplit(":", 1)[1].split("/")[0]
                    break
            tabs = json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json"))
            tab = next(tab for tab in tabs if tab["type"] == "page")
            async with websockets.connect(tab["webSocketDebuggerUrl"], max_size=None) as socket:
                number = 0

                async def call(method, **params):
                    nonlocal number
                    number += 1
                    await socket.send(json.dumps({"id": number, "method": method, "params": params}))
                    while True:
                        answer = json.loads(await socket.recv())
                        if answer.get("id") == number:
                            return answer.get("result", answer)

                await call("Emulation.setDeviceMetricsOverride", width=420, height=900, deviceScaleFactor=1, mobile=False)
                await call("Page.navigate", url=f"http://{address}/")
                look = "[document.documentElement.dataset.ticks, document.getElementById('state').textContent, document.getElementById('pos').textContent, document.documentElement.scrollWidth].join(' ')"
                for _ in range(2):
                    await asyncio.sleep(3)
                    shown = await call("Runtime.evaluate", expression=look, returnByValue=True)
                    print("shown", shown["result"]["value"])
        finally:
            browser.terminate()
            browser.wait()


if sys.argv[1] == "metrics":
    metrics(sys.argv[2])
elif sys.argv[1] == "foxglove":
    asyncio.run(foxglove(sys.argv[2]))
else:
    asyncio.run(page(sys.argv[2], sys.argv[3]))
