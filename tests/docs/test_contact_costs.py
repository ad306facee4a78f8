"""The costs of the offsets have one home in the package; help, account and page give the same figures."""

import pathlib

import clothsim as cs
import pytest
from clothsim.model.sphere import CONTACT_COSTS

PAGE = pathlib.Path(__file__).parents[2] / "docs/contact.md"


@pytest.mark.parametrize("offset", CONTACT_COSTS)
def test_page_account_and_help_agree(offset):
    cost = CONTACT_COSTS[offset]
    (row,) = [line for line in PAGE.read_text().splitlines() if line.startswith(f'| `"{offset}"') and line.count("|") == 7]
    assert [float(cell) for cell in row.split("|")[2:7]] == list(cost)
    scene = cs.Scene(cs.Cloth(), cs.Sphere(offset=offset))
    (account,) = scene.explain()["contact_costs"]
    assert list(account.values()) == [cost.untouched, cost.touched, cost.drape_mean, cost.drape_worst]
    (account,) = scene.explain(precision="single")["contact_costs"]
    assert account["all points touched"] == cost.touched_in_single
    assert f"on light drapes {cost.drape_mean}" in str(scene.explain())
    figures = {"cell": (cost.touched, cost.touched_in_single), "face": (cost.drape_mean, cost.drape_worst)}
    assert all(f" {figure}" in cs.Sphere.__doc__ for figure in figures.get(offset, ()))


def test_a_length_costs_as_none_and_the_papers_responses_as_no_sphere():
    scene = cs.Scene(cs.Cloth(), [cs.Sphere(offset=0.01), cs.Sphere(response="ray", offset="edge")])
    length, ray = scene.explain()["contact_costs"]
    assert length["all points touched"] == CONTACT_COSTS["none"].touched
    assert ray == {"untouched": 1.0}
