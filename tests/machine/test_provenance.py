"""Where numbers come from, and how long steps took."""

import clothsim as cs
from clothsim.machine.origin import provenance


def test_provenance_names_build_machine_and_time():
    about = provenance()
    assert about["build"] == cs.build_config()
    assert about["machine"]["cpu"] and about["machine"]["cores"] >= 1
    assert about["created"].endswith("+00:00")
