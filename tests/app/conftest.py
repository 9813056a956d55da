import pytest
from device_bench import Bench


@pytest.fixture
def bench():
    return Bench()
