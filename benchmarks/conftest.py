"""What a saved run of pytest-benchmark does not keep: whose machine and whose branch it was."""

import pytest

KEPT = ("id", "time", "dirty")


@pytest.hookimpl(optionalhook=True)
def pytest_benchmark_update_machine_info(machine_info):
    for key in ("node", "release"):  # names of the host and of its kernel
        machine_info.pop(key, None)


@pytest.hookimpl(optionalhook=True)
def pytest_benchmark_update_commit_info(commit_info):
    for key in set(commit_info).difference(KEPT):
        del commit_info[key]
