"""The C codec, built twice: as a library to pack with, and with the address sanitizer to throw bytes at."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "protocol"))

from layout import Field, Schema, load  # noqa: E402

SOURCES = [str(ROOT / "firmware" / "app" / f"{name}.c") for name in ("wire", "cobs", "crc32", "frame")]
CC = [os.environ.get("CC", "cc"), "-std=c11", "-O1", "-g", "-Wall", "-Wextra", "-Werror", f"-I{ROOT / 'firmware'}"]

DRIVER = """\
#include "app/frame.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Unpacks and packs again, in heap blocks of exactly the right size -1: refused. */
static int32_t again(uint8_t type, const uint8_t *in, size_t size, uint8_t *out)
{
    switch (type) {
%s
    }
    return -1;
}

static void report(const uint8_t *raw, size_t raw_size)
{
    uint8_t *body = malloc(raw_size + 1), *copy, *frame = malloc(FRAME_MAX);
    struct wire_header header;
    const uint8_t *payload;
    size_t size;
    memcpy(body, raw, raw_size);
    if (frame_open(body, raw_size, &header, &payload, &size)) {
        copy = malloc(WIRE_MAX_BODY);
        uint8_t *exact = malloc(size), *packed = malloc(size);
        if (size > 0)
            memcpy(exact, payload, size);
        if (again(header.type, exact, size, packed) == (int32_t)size) {
            if (size > 0)
                memcpy(copy + WIRE_HEADER_SIZE, packed, size);
            size_t n = frame_seal(&header, copy, size, frame);
            for (size_t i = 0; i < n; i++)
                printf("%%02x", frame[i]);
            printf(" ");
        }
        free(packed);
        free(exact);
        free(copy);
    }
    free(frame);
    free(body);
}

int main(void)
{
    uint8_t prefix[4];
    while (fread(prefix, 1, 4, stdin) == 4) {
        size_t size = prefix[0] | prefix[1] << 8 | prefix[2] << 16;
        uint8_t *line = malloc(size + 1), *buffer = malloc(WIRE_MAX_BODY);
        struct cobs_decoder decoder;
        if (fread(line, 1, size, stdin) != size)
            return 1;
        cobs_decoder_init(&decoder, buffer, WIRE_MAX_BODY);
        for (size_t i = 0; i < size; i++)
            if (cobs_decoder_push(&decoder, line[i]) == COBS_FRAME)
                report(buffer, decoder.size);
        printf("\\n");
        fflush(stdout);
        free(buffer);
        free(line);
    }
    return 0;
}
"""


def compile_c(*arguments: str) -> None:
    subprocess.run([*CC, *arguments], check=True, timeout=120)


@pytest.fixture(scope="session")
def schema() -> Schema:
    return load(ROOT / "protocol" / "schema.toml")


class CodecC:
    """Packs values into C structs laid out from the schema, and calls the generated functions."""

    def __init__(self, path: Path, schema: Schema) -> None:
        self.library = ctypes.CDLL(str(path))
        self.schema = schema
        self.structs: dict[str, type[ctypes.Structure]] = {}
        for record in schema.records.values():
            self.structs[record.name] = self._struct(record.name, record.fields)
        for message in schema.messages:
            same = message.fields == schema.reply_head
            name = "reply_head" if same else message.full_name
            self.structs[message.full_name] = self._struct(name, message.fields)
        self.c_names = {
            m.full_name: "reply_head" if m.fields == schema.reply_head else m.full_name for m in schema.messages
        }

    def _struct(self, name: str, fields: tuple[Field, ...]) -> type[ctypes.Structure]:
        members: list[tuple[str, Any]] = []
        for f in fields:
            if f.is_tail:
                members += [(f.name, ctypes.c_char_p), (f.name + "_size", ctypes.c_size_t)]
                continue
            bits = f.base[1:]
            sign = "int" if f.base[0] == "i" else "uint"
            base = self.structs[f.base] if f.base in self.structs else getattr(ctypes, f"c_{sign}{bits}")
            members.append((f.name, base * f.count if f.count else base))
        return type(name, (ctypes.Structure,), {"_fields_": members})

    def _fill(self, struct: Any, fields: tuple[Field, ...], message: Any) -> None:
        for f in fields:
            value = getattr(message, f.name)
            if f.is_tail:
                setattr(struct, f.name, value)
                setattr(struct, f.name + "_size", len(value))
            elif f.base in self.schema.records:
                for slot, item in zip(getattr(struct, f.name), value, strict=True):
                    self._fill(slot, self.schema.records[f.base].fields, item)
            elif f.count:
                getattr(struct, f.name)[:] = list(value)
            else:
                setattr(struct, f.name, value)

    def pack(self, name: str, fields: tuple[Field, ...], message: Any) -> bytes:
        """Payload as C writes it into a buffer that has no byte to spare."""
        if not fields:
            return b""
        struct = self.structs[name]()
        self._fill(struct, fields, message)
        size = len(message.pack())
        out = ctypes.create_string_buffer(max(size, 1))
        function = getattr(self.library, f"wire_pack_{self.c_names.get(name, name)}")
        function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t]
        assert function(ctypes.byref(struct), out, size - 1) == -1
        assert function(ctypes.byref(struct), out, size) == size
        return out.raw[:size]


@pytest.fixture(scope="session")
def codec_c(tmp_path_factory: pytest.TempPathFactory, schema: Schema) -> CodecC:
    path = tmp_path_factory.mktemp("wire") / "wire.so"
    compile_c("-shared", "-fPIC", "-fsanitize=undefined", "-fno-sanitize-recover=all", *SOURCES, "-o", str(path))
    return CodecC(path, schema)


class LineC:
    """Throws bytes at the decoder and gives what it accepted, packed again into frames."""

    def __init__(self, path: Path) -> None:
        self.process = subprocess.Popen([str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def accepted(self, line: bytes) -> list[bytes]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(len(line).to_bytes(4, "little") + line)
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        assert answer.endswith(b"\n"), "the C decoder crashed"
        return [bytes.fromhex(word.decode()) for word in answer.split()]


@pytest.fixture(scope="session")
def line_c(tmp_path_factory: pytest.TempPathFactory, schema: Schema) -> Any:
    folder = tmp_path_factory.mktemp("line")
    cases = []
    for m in schema.messages:
        if not m.fields:
            cases.append(f"    case 0x{m.number:02X}: return size == 0 ? 0 : -1;")
            continue
        name = "reply_head" if m.fields == schema.reply_head else m.full_name
        call = f"wire_unpack_{name}(&m, in, size) ? wire_pack_{name}(&m, out, size) : -1"
        cases.append(f"    case 0x{m.number:02X}: {{ struct wire_{name} m; return {call}; }}")
    (folder / "line.c").write_text(DRIVER % "\n".join(cases))
    program = folder / "line"
    compile_c(
        "-fsanitize=address,undefined",
        "-fno-sanitize-recover=all",
        str(folder / "line.c"),
        *SOURCES,
        "-o",
        str(program),
    )
    line = LineC(program)
    yield line
    line.process.kill()
    line.process.communicate()
