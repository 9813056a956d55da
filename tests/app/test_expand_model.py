"""No byte beside a model is touched while it is worked out: by the compiler's sanitizers."""

import subprocess

import pytest
from c_driver import build
from device_bench import model

SANITIZE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@pytest.fixture(scope="module")
def expand_model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("expand_model")
    try:
        return build(folder, "expand_model", *SANITIZE)
    except subprocess.CalledProcessError:  # a compiler without the sanitizers' libraries
        return build(folder, "expand_model")


@pytest.mark.parametrize(("fields", "fits"), [({}, True), ({"flags": 1}, True), ({"error_limit_q16": -1}, False)])
def test_memory_is_in_order(expand_model, fields, fits):
    done = subprocess.run([expand_model], input=model(**fields).pack(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    assert (int(done.stdout) == 0) == fits
