# SPDX-License-Identifier: GPL-3.0-or-later
"""Sends the OpenJD bundle by the command of AWS Deadline Cloud to a server here that stands for the service. Linux and macOS.

python3 scripts/dev/farms/try_deadline.py

deadline and openjd-cli are installed into a temporary folder if they are missing. `deadline bundle submit` reads the bundle and
sends a job. Its template and its parameters must arrive, and openjd-cli must make the right steps and tasks of them. Nothing is
baked: try_openjd.py runs the same template.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import small_sets

BUNDLE = small_sets.FARM / "openjd"
MOST_SHARDS = "1000"
"""The bundle's limit."""
NUMBER = 32 * "0"
"""What follows the kind in an ID of the service."""
QUEUE = {"displayName": "Test", "status": "IDLE", "defaultBudgetAction": "NONE"}
JOB = {"jobId": f"job-{NUMBER}", "name": "Test", "priority": 50, "lifecycleStatus": "CREATE_COMPLETE"}
JOB["lifecycleStatusMessage"] = "created"
COMMON = {
    "farmId": f"farm-{NUMBER}",
    "queueId": f"queue-{NUMBER}",
    "createdAt": "2026-01-01T00:00:00Z",
    "createdBy": "me",
}


class Service(BaseHTTPRequestHandler):
    """Answers as a queue without environments, and keeps the job that is sent."""

    sent = None

    def do_GET(self):  # noqa: N802 - the base class calls it
        place = self.path.split("?")[0]
        if place.endswith("/environments"):
            self._answer({"environments": []})
        else:
            self._answer({**COMMON, **(JOB if "/jobs/" in place else QUEUE)})

    def do_POST(self):  # noqa: N802
        Service.sent = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self._answer({"jobId": JOB["jobId"]})

    def _answer(self, value):
        data = json.dumps(value).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_):
        pass


def submit(deadline, url, folder, **values):
    """Send the bundle. Returns the exit code."""
    environment = {
        "PATH": os.environ["PATH"],
        "HOME": str(folder),
        "AWS_ACCESS_KEY_ID": "none",
        "AWS_SECRET_ACCESS_KEY": "none",
        "AWS_DEFAULT_REGION": "us-west-2",
        "AWS_ENDPOINT_URL_DEADLINE": url,
        "AWS_DISABLE_HOST_PREFIX_INJECTION": "true",
        "DEADLINE_CLOUD_TELEMETRY_OPT_OUT": "true",
    }
    given = [word for key, value in values.items() for word in ("--parameter", f"{key}={value}")]
    place = ["--farm-id", COMMON["farmId"], "--queue-id", COMMON["queueId"], "--yes"]
    return subprocess.call([deadline, "bundle", "submit", str(BUNDLE), *place, *given], env=environment)


def faults(openjd, sent, folder, **wanted):
    """Yield what is wrong with the job that was sent. wanted: values of the bundle's parameters."""
    arrived = {name: next(iter(value.values())) for name, value in sent["parameters"].items()}
    print(f"arrived: {arrived}")
    yield from (f"{name} is {arrived.get(name)!r}" for name, value in wanted.items() if arrived.get(name) != value)
    template = folder / "template.yaml"
    template.write_text(sent["template"], encoding="utf-8")
    given = [word for name, value in arrived.items() for word in ("--job-param", f"{name}={value}")]
    summary = [openjd, "summary", str(template), "--output", "json", *given]
    job = json.loads(subprocess.run(summary, stdout=subprocess.PIPE, check=False).stdout)
    print(f"{job.get('message')}: {job.get('total_steps')} steps, {job.get('total_tasks')} tasks")
    if (job.get("total_steps"), job.get("total_tasks")) != (3, int(wanted["Shards"]) + 2):
        yield "the job has other steps or tasks"


def main():
    argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0]).parse_args()
    with (
        tempfile.TemporaryDirectory(prefix="imprint-deadline-") as name,
        HTTPServer(("127.0.0.1", 0), Service) as server,
    ):
        folder = Path(name).resolve()
        deadline = small_sets.program("deadline", "deadline", folder / "deadline")
        openjd = small_sets.program("openjd", "openjd-cli", folder / "openjd")
        threading.Thread(target=server.serve_forever, daemon=True).start()
        small_sets.write(folder / "props", 2)
        values = {"Folder": str(folder / "props"), "Jobs": "jobs.json", "Shards": MOST_SHARDS}
        code = submit(deadline, f"http://127.0.0.1:{server.server_port}", folder, **values)
        found = [f"deadline bundle submit: exit code {code}"] if code else []
        found += faults(openjd, Service.sent, folder, **values) if Service.sent else ["no job was sent"]
        server.shutdown()
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
