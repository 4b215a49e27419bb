"""Networks of the table by name."""

from jaxsim.studies.ablation.table import besides, modality


def test_networks_have_the_papers_names_whatever_the_order_of_their_inputs():
    assert modality(("edges", "semantic", "rgb", "depth")) == "combined"
    assert modality(("rgb", "depth", "row")) == "rgb+depth"
    assert modality(("incidence", "row")) == "none"
    assert besides(("row", "rgb", "incidence")) == ("row", "incidence")
