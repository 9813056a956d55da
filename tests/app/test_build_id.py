"""The build says which source it is of, as the hexadecimal digits that it was compiled with."""

import ctypes
import os
import subprocess

import pytest
from c_driver import FLAGS, ROOT

SIZE = 20


def said(folder, digits):
    library = folder / "build_id.so"
    source = ROOT / "firmware" / "app" / "build_id.c"
    define = f'-DPHASELEAD_BUILD_ID="{digits}"'
    subprocess.run([os.environ.get("CC", "cc"), *FLAGS, define, "-shared", "-fPIC", source, "-o", library], check=True)
    out = (ctypes.c_uint8 * SIZE)()
    ctypes.CDLL(str(library)).build_id(out)
    return bytes(out)


@pytest.mark.parametrize("digits", ["0123456789abcdef" + "a9f0" * 6, "00ff"])
def test_every_digit_is_there_and_what_is_missing_is_zero(tmp_path, digits):
    assert said(tmp_path, digits) == bytes.fromhex(digits).ljust(SIZE, b"\0")
