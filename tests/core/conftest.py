import os
import shutil

import pytest
from core_bindings import Core, compile_core
from hypothesis import settings

settings.register_profile("core", deadline=None)  # a busy machine is no failure
settings.load_profile("core")


@pytest.fixture(scope="session")
def core(tmp_path_factory):
    """The core as a shared library, built by the system's compiler."""
    library = tmp_path_factory.mktemp("core") / "libcore.so"
    return Core(compile_core(library, os.environ.get("CC", "cc"), "-O2", "-shared", "-fPIC"))


@pytest.fixture(scope="session")
def compiler():
    """Looks a compiler up, or skips the test with the reason."""

    def find(name):
        if shutil.which(name) is None:
            pytest.skip(f"{name} is not installed")
        return name

    return find
