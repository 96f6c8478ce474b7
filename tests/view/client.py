# SPDX-License-Identifier: Apache-2.0
"""A page without a browser: speaks to `marram view` by WebSocket (RFC 6455), with Python's standard library."""
import base64
import json
import os
import socket
import struct
import subprocess
import urllib.parse


class Program:
    """`marram view` of a scene; .address is what it prints, "" if it has ended instead."""

    def __init__(self, program, scene, *options):
        self.process = subprocess.Popen([program, "view", scene, "--no-open", "--quiet", *options],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.address = self.process.stdout.readline().strip()

    def close(self):
        """Ends it as Ctrl-C does. Returns its exit code and its messages."""
        self.process.send_signal(2)
        _, messages = self.process.communicate(timeout=60)
        return self.process.returncode, messages

    def alive(self):
        return self.process.poll() is None

    def stop(self):
        if self.alive():
            self.process.kill()
            self.process.communicate()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()


def request(address, path=None, headers=None, method="GET", host=None):
    """A plain HTTP request. Returns the status and the body; 0 if the connection was closed without an answer."""
    url = urllib.parse.urlsplit(address)
    with socket.create_connection((url.hostname, url.port), timeout=60) as line:
        text = f"{method} {url.path if path is None else path} HTTP/1.1\r\nHost: {host or url.netloc}\r\n"
        text += "".join(f"{name}: {value}\r\n" for name, value in (headers or {}).items())
        line.sendall((text + "Connection: close\r\n\r\n").encode())
        answer = b""
        try:
            while piece := line.recv(65536):
                answer += piece
        except ConnectionError:
            pass
    head, _, body = answer.partition(b"\r\n\r\n")
    return int(head.split()[1]) if head else 0, body


class Page:
    """A connection. receive() gives ("text", object) or ("binary", header, payload)."""

    def __init__(self, address, origin=None, host=None):
        url = urllib.parse.urlsplit(address)
        self.line = socket.create_connection((url.hostname, url.port), timeout=60)
        host = host or url.netloc
        key = base64.b64encode(os.urandom(16)).decode()
        self.line.sendall((f"GET {url.path}socket HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\n"
                           f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
                           f"Origin: {origin or 'http://' + host}\r\n\r\n").encode())
        head = b""
        while b"\r\n\r\n" not in head:
            piece = self.line.recv(1)
            if not piece:
                break
            head += piece
        self.status = int(head.split()[1])

    def send_bytes(self, data, opcode=1):
        mask = os.urandom(4)
        size = len(data)
        head = bytes([0x80 | opcode])
        head += (bytes([0x80 | size]) if size < 126 else bytes([0xFE]) + struct.pack(">H", size)
                 if size < 65536 else bytes([0xFF]) + struct.pack(">Q", size))
        long_mask = mask * (size // 4 + 1)
        masked = (int.from_bytes(data, "big") ^ int.from_bytes(long_mask[:size], "big")).to_bytes(size, "big")
        self.line.sendall(head + mask + masked)

    def send(self, **message):
        self.send_bytes(json.dumps(message).encode())

    def _read(self, count):
        data = bytearray()
        while len(data) < count:
            piece = self.line.recv(min(count - len(data), 1 << 20))
            if not piece:
                raise ConnectionError("the program has closed the connection")
            data += piece
        return bytes(data)

    def receive(self):
        whole, kind = b"", 0
        while True:
            first, second = self._read(2)
            size = second & 0x7F
            if size == 126:
                size = struct.unpack(">H", self._read(2))[0]
            elif size == 127:
                size = struct.unpack(">Q", self._read(8))[0]
            data = self._read(size)
            opcode = first & 0x0F
            if opcode == 8:
                raise ConnectionError("closed: " + data[2:].decode(errors="replace"))
            if opcode == 9:
                self.send_bytes(data, 10)
                continue
            if opcode == 10:
                continue
            kind = opcode or kind
            whole += data
            if first & 0x80:
                break
        if kind == 1:
            return "text", json.loads(whole)
        length = struct.unpack("<I", whole[:4])[0]
        return "binary", json.loads(whole[4:4 + length]), whole[4 + length:]

    def until(self, kind, **fields):
        """The next message of this type, with these fields. Others are passed over."""
        while True:
            message = self.receive()
            if message[1].get("type") == kind and all(message[1].get(k) == v for k, v in fields.items()):
                return message[1:] if message[0] == "binary" else message[1]

    def close(self):
        self.line.close()
