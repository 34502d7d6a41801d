# SPDX-License-Identifier: GPL-3.0-or-later
"""A worker that bakes nothing and says what a test wants it to. It is a program of plain Python, which starts at once.

Its only argument is a file of JSON with what it sends: "ready", "liar" and "honest" are lists of steps, bytes in Latin-1. The
last two are done when a bake arrives in whose options the word is.
"""

import json
import os
import socket
import sys
import time
from multiprocessing.connection import Connection

with open(sys.argv[1], encoding="utf-8") as file:
    steps = json.load(file)
number = int(os.environ["IMPRINT_WORKER"])
connection, end = Connection(number), socket.socket(fileno=os.dup(number))


def act(kind, text=""):
    content = text.encode("latin-1")
    match kind:
        case "message":
            connection.send_bytes(content)
        case "raw":
            end.sendall(content)
        case "drip":
            for byte in content:
                end.sendall(bytes([byte]))
                time.sleep(0.3)
        case "flood":
            while True:
                connection.send_bytes(content)
                connection.recv_bytes()
        case "pour":
            while True:
                connection.send_bytes(content)
        case "close":
            connection.close()
            end.close()
        case "write no more":
            end.shutdown(socket.SHUT_WR)
        case "read no more":
            end.shutdown(socket.SHUT_RD)
        case "leave":
            os._exit(int(text))


for step in steps["ready"]:
    act(*step)
while True:
    arrived = connection.recv_bytes()
    word = "liar" if b"liar" in arrived else "honest"
    for step in steps[word]:
        act(*step)
    if word == "liar":
        time.sleep(1000)
