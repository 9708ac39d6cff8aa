"""The keys of data sets with several channels: completed, or refused in one sentence."""

from pathlib import Path

import pytest
import yaml

from evopem.config.channels import ChannelPlace, of_each
from evopem.config.defaults import complete, read_settings, yaml_text
from evopem.config.structures import is_polynomial, searched_forms
from evopem.errors import InputError

OE = "input: [a, b]\n    output: y\n    structure: oe\n    "
GEOMETRY = """
    geometry:
      points: {root: [0, 0], tip: [0, 1]}
      lines: [[root, tip]]
      channels: {acc: {point: tip, direction: -x}}
"""


def dataset(keys, defaults=""):
    text = f"datasets:\n  a:\n    file: a.csv\n    {keys}\n"
    if defaults:
        text += f"defaults: {defaults}\n"
    return complete(yaml.safe_load(text)).datasets["a"]


def refusal(keys, defaults=""):
    with pytest.raises(InputError) as caught:
        dataset(keys, defaults)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_lists_of_channels_mean_a_state_space_model():
    found = dataset(
        "output: [y1, 4, 'acc_*']\n    input: u\n    output_unit: {y1: m}\n    input_unit: [N]"
    )
    assert searched_forms(found) == ("ss", "ss_oe", "ss_oe_drift", "ss_bj")
    assert found.source.channels.inputs == ("u",)
    assert found.source.channels.outputs == ("y1", 4, "acc_*")
    assert found.source.channels.output_unit == {"y1": "m"}
    assert found.source.channels.input_unit == "N"
    assert (found.preparation.split.discard, found.preparation.split.estimation) == (0, 0.8)


def test_so_does_a_pattern_without_a_list():
    found = dataset("output: acc_*\n    input: u")
    assert "arx" not in searched_forms(found)
    assert found.source.channels.outputs == ("acc_*",)


def test_the_structure_alone_does_so_too():
    found = dataset("structure: state_space")
    assert found.source.channels.inputs == (1,)
    assert found.source.channels.outputs == (2,)


def test_several_inputs_and_one_output_take_every_polynomial_structure():
    keys = "input: [u1, u2]\n    output: y\n    structure: {}\n    orders: {{plant: [2, 5]}}"
    for structure in ("arx", "armax", "ararx", "ararmax", "oe", "bj", "general"):
        found = dataset(keys.format(structure))
        assert searched_forms(found)[-1] == structure
        assert found.automatic.orders.plant == (2, 5)


def test_polynomial_structures_are_searched_beside_state_space_where_nothing_is_written():
    polynomial = ["fir", "impulse", "arx", "armax", "oe", "ararx", "ararmax", "bj"]
    of_two_inputs = "input: [u1, u2]\n    output: y"
    forms = searched_forms(dataset(of_two_inputs))
    assert list(forms) == [*polynomial, "ss", "ss_oe", "ss_oe_drift", "ss_bj"]
    assert list(searched_forms(dataset(""))) == [*polynomial, "ss"]
    assert searched_forms(dataset("input: none\n    output: y")) == ("arma", "ss")
    for keys in ("orders: {nc: 2}", f"{of_two_inputs}\n    orders: {{nc: 2}}"):
        assert list(searched_forms(dataset(keys))) == polynomial
    for keys in (
        "input: [u1, u2]\n    output: [y, z]",
        "input: [u1, u2]\n    output: 'y*'",
        "input: [u1, u2]\n    output: y\n    structure: state_space",
        "input: [u1, u2]\n    output: y\n    form: ss",
    ):
        assert not set(polynomial).intersection(searched_forms(dataset(keys)))


def test_a_structure_from_the_defaults_holds_for_several_inputs_too():
    found = dataset("input: [u1, u2]\n    output: y", "{structure: oe, form: ss}")
    assert searched_forms(found) == ("arx", "armax", "oe")


@pytest.mark.parametrize("keys", ["form: ss", "structure: state_space", "weighting: noise"])
def test_so_do_the_keys_of_state_space_models(keys):
    found = dataset(keys)
    assert not any(map(is_polynomial, searched_forms(found)))
    assert found.source.channels_from_file


def test_a_list_or_a_mapping_of_one_is_the_channel_itself():
    """What holds for `u` holds for `[u]`."""
    alone = dataset(
        "input: u\n    output: y\n    input_unit: N\n    output_unit: m\n    delay: {nk: 1}\n"
        "    orders: {nb: [1, 3]}"
    )
    listed = dataset(
        "input: [u]\n    output: [y]\n    input_unit: [N]\n    output_unit: {y: m}\n"
        "    delay: {nk: {u: 1}}\n    orders: {nb: [[1, 3]]}"
    )
    assert alone == listed


def test_several_channels_take_the_settings_that_one_takes():
    keys = "search: {seed: 3}\n    spectrum: {nfft: 512}\n"
    keys += "    transforms: {difference: 1, difference_input: 1}"
    one, several = dataset(keys), dataset(f"output: [2, 3]\n    {keys}")
    for name in ("preparation", "spectrum"):
        assert getattr(one, name) == getattr(several, name)
    assert (several.search.seed, several.spectrum.nfft) == (3, 512)
    assert one.automatic.preparation == several.automatic.preparation


def test_a_transform_of_one_output_is_left_out_of_defaults_for_several():
    defaults = "{transforms: {box_cox: auto, difference: 1}}"
    assert dataset("", defaults).preparation.transforms.box_cox == "auto"
    several = dataset("output: [2, 3]", defaults).preparation.transforms
    assert (several.box_cox, several.difference) == ("none", 1)
    refused = refusal("output: [2, 3]\n    transforms: {box_cox: auto}")
    assert "datasets.a.transforms.box_cox: there are several outputs" in refused


def test_an_output_alone():
    found = dataset("output: [1, 2]\n    input: none")
    assert found.source.channels.inputs == ()


def test_defaults_serve_both_kinds_of_data_sets():
    text = """
      datasets:
        one: {file: a.csv, structure: arx}
        several: {file: b.csv, output: [2, 3]}
      defaults:
        structure: state_space
        form: ss_oe
        split: {discard: 10}
        orders: {nx: 4}
        search: {seed: 7, max_root_radius: 0.99}
    """
    found = complete(yaml.safe_load(text)).datasets
    assert searched_forms(found["one"]) == ("arx",)
    assert found["one"].search.seed == found["several"].search.seed == 7
    assert found["several"].automatic.form == "ss_oe"
    assert found["several"].automatic.orders.nx == (4, 4)
    assert found["several"].preparation.split.discard == 10


@pytest.mark.parametrize(
    ("written", "ranges"),
    [
        ("2", ((2, 2), (2, 2))),
        ("[2, 4]", ((2, 4), (2, 4))),
        ("[[2, 4], [1, 1]]", ((2, 4), (1, 1))),
        ("{cold: [1, 3]}", (None, (1, 3))),
        ("{hot: 2, cold: 1}", ((2, 2), (1, 1))),
    ],
)
def test_orders_and_delays_of_each_input(tmp_path, written, ranges):
    found = dataset(
        f"input: [hot, cold]\n    output: y\n    structure: oe\n    delay: {{nk: {written}}}\n"
        f"    orders: {{nb: {written}, nf: {written}, plant: [1, 4]}}"
    )
    orders = found.automatic.orders
    for each in (orders.nb, orders.nf, orders.nk):
        assert of_each(each, ("hot", "cold"), "") == ranges
    assert orders.plant == (1, 4)
    file = tmp_path / "config.yaml"
    file.write_text(yaml_text(found))
    assert read_settings(file) == found
    again = complete({"datasets": {"a": found.keys}})
    assert again.datasets["a"] == found


def test_ranges_of_defaults_hold_where_the_structure_has_the_order():
    defaults = "{orders: {nc: [2, 4], nb: 3, nf: 2}, delay: {nk: [[0, 2], [1, 1]]}}"
    several = dataset(OE.strip(), defaults).automatic.orders
    assert (several.nc, several.nb, several.nf) == (None, (3, 3), (2, 2))
    assert several.nk == ((0, 2), (1, 1))
    one = dataset("recipe: chapter\n    structure: oe", defaults.replace("[[0, 2], [1, 1]]", "2"))
    assert one.order_grid.ranges.nb == (3, 3)
    assert one.order_grid.ranges.nk == (2, 2)
    refused = refusal("recipe: chapter\n    structure: oe", defaults)
    assert "defaults.delay.nk: there are 2 values and 1 inputs" in refused


def test_constraints_come_back(tmp_path):
    found = dataset(
        "input: [a, b]\n    output: y\n    structure: oe\n    focus: simulation\n"
        "    constraints: {static_gain: {a: 2}, static_gain_bounds: {b: [0, null]},"
        " forbidden_bands: [[1, 2]], max_pole_radius: 0.9}"
    )
    file = tmp_path / "config.yaml"
    file.write_text(yaml_text(found))
    assert read_settings(file) == found
    assert found.fit.constraints.of_input("a").static_gain == 2
    assert found.fit.constraints.of_input("b").static_gain_bounds == (0, None)
    assert found.fit.constraints.of_input("a").max_pole_radius == 0.9
    assert found.fit.focus == "simulation"


@pytest.mark.parametrize("channels", ["", "input: [1, 2]\n    output: 3\n    "])
def test_only_forms_that_can_be_fitted_are_searched(channels):
    everything = searched_forms(dataset(channels))
    simulated = searched_forms(dataset(channels + "focus: simulation"))
    assert simulated == tuple(form for form in everything if form != "ss")
    assert searched_forms(dataset(channels + "focus: prediction")) == everything
    fixed = "constraints: {fixed_coefficients: {a1: -1.2}}"
    if not channels:
        # A regularised response has a prior of its own alone, and fir no poles.
        assert searched_forms(dataset(fixed)) == ("fir", *everything[2:-1])
        assert searched_forms(dataset("constraints: {real_poles: none}")) == everything[2:]


def test_complete_keys_come_back(tmp_path):
    found = dataset(
        "input: [1, u2]\n    output: [acc, 5]\n    output_unit: [m, s]\n    time: 4\n"
        "    validation_file: b.csv\n    resample: 20\n    form: ss_oe\n"
        "    weighting: power\n    delay: {nk: [1, 3]}\n    orders: {nx: [2, 8]}\n"
        "    purpose: prediction\n    search: {seed: 3, evaluations: 50, objective: absolute}"
        + GEOMETRY
    )
    file = tmp_path / "config.yaml"
    file.write_text(yaml_text(found))
    assert read_settings(file) == found
    assert found.search.objective == "absolute"
    assert found.geometry.channels["acc"] == ChannelPlace("tip", (-1.0, 0.0, 0.0))
    again = complete({"datasets": {"a": found.keys}})
    assert again.datasets["a"] == found


@pytest.mark.parametrize(
    ("keys", "place", "says"),
    [
        ("output: [y, y]", "datasets.a.output", "y stands there twice"),
        ("output: [u, y]\n    input: [u]", "datasets.a.output", "u is both input and output"),
        ("output: [2, 3]\n    time: 3", "datasets.a.output", "3 is both time and output"),
        (
            "output: [2, 3]\n    structure: oe",
            "datasets.a.structure",
            "a polynomial model has one output",
        ),
        (
            "input: [1, 2]\n    output: 'y*'\n    structure: bj",
            "datasets.a.structure",
            "one output",
        ),
        ("input: [1, 2]\n    output: 3\n    structure: arma", "datasets.a.input", "no input"),
        (
            "input: none\n    output: [3]\n    structure: arx",
            "datasets.a.input",
            "needs an input, and there is none",
        ),
        (
            "input: [1, 2]\n    output: 3\n    structure: oe\n    form: ss",
            "datasets.a.form",
            "structure oe has no such key",
        ),
        (
            "input: [1, 2]\n    output: 3\n    structure: oe\n    orders: {nx: 3}",
            "datasets.a.orders.nx",
            "structure oe has no such range",
        ),
        ("output: [2, 3]\n    recipe: chapter", "datasets.a.recipe", "the chapter's recipe"),
        ("output: []", "datasets.a.output", "holds 0 values"),
        (
            "output: [2, 3]\n    output_unit: [m]",
            "datasets.a.output_unit",
            "1 values and 2 outputs",
        ),
        ("output: [2, 3]\n    orders: {plant: 3}", "datasets.a.orders.plant", "give one of nx"),
        ("output: [2, 3]\n    orders: {nx: [4, 2]}", "datasets.a.orders.nx", "above the upper one"),
        ("output: [2, 3]\n    search: {prune: true}", "datasets.a.search.prune", "no such key"),
        (
            "output: [2, 3]\n    weighting: determinant\n    search: {objective: absolute}",
            "datasets.a.weighting",
            "no covariance",
        ),
        ("output: [2, 3]\n    constraints: {real_poles: none}", "datasets.a.constraints", "oe"),
        (
            "input: [1, 2]\n    output: 3\n    structure: oe\n    constraints: {static_gain: 2}",
            "datasets.a.constraints.static_gain",
            "a mapping from their names",
        ),
        (
            "input: [a, b]\n    output: y\n    structure: oe\n"
            "    constraints: {static_gain: {c: 2}}",
            "datasets.a.constraints.static_gain",
            "there is no input c",
        ),
        (
            "input: [1, 2]\n    output: 3\n    form: ss\n    constraints: {stability: free}",
            "datasets.a.constraints.stability",
            "stable models",
        ),
        (
            "input: [1, 2]\n    output: 3\n    form: ss\n"
            "    constraints: {fixed_coefficients: {a1: 2}}",
            "datasets.a.constraints.fixed_coefficients.a1",
            "depend on the choice of its states",
        ),
        (
            "input: [1, 2]\n    output: 3\n    structure: oe\n"
            "    constraints: {fixed_coefficients: {b1: 2}}",
            "datasets.a.constraints.fixed_coefficients.b1",
            "each of several inputs has b1",
        ),
        ("constraints: {static_gain: {u: 2}}", "datasets.a.constraints.static_gain", "alone"),
        (
            "output: [2, 3]\n    form: ss\n    focus: simulation",
            "datasets.a.focus",
            "write ss_oe",
        ),
        (
            "output: [2, 3]\n    input: none\n    focus: simulation",
            "datasets.a.focus",
            "nothing to simulate",
        ),
        ("output: [2, 3]\n    input: none\n    delay: {nk: 1}", "datasets.a.delay", "no input"),
        (
            "output: [2, 3]\n    input: none\n    purpose: simulation",
            "datasets.a.purpose",
            "nothing to simulate",
        ),
        (
            "output: [2, 3]\n    input: none\n    form: ss_oe",
            "datasets.a.form",
            "a plant that inputs drive",
        ),
        ("structure: arx\n    orders: {nf: 3}", "datasets.a.orders.nf", "no such range"),
        ("delay: {nk: {u: 1}}", "datasets.a.delay.nk", "there is no input u"),
        (OE + "orders: {nb: [1, 2, 3]}", "datasets.a.orders.nb", "such as [[2, 2], [1, 1]]"),
        (OE + "orders: {nb: [[1, 2], 3]}", "datasets.a.orders.nb", "numbers beside ranges"),
        (OE + "orders: {nb: [[1, 2]]}", "datasets.a.orders.nb", "1 values and 2 inputs"),
        (OE + "orders: {nb: [[1, 2, 3], [1, 1]]}", "datasets.a.orders.nb", "holds 3 values"),
        (OE + "orders: {nb: {v: 2}}", "datasets.a.orders.nb", "there is no input v"),
        (OE + "orders: {nb: 0}", "datasets.a.orders.nb", "below 1"),
        (OE + "orders: {nf: [[3, 2], [1, 1]]}", "datasets.a.orders.nf", "above the upper one"),
        (OE + "orders: {nc: 2}", "datasets.a.orders.nc", "give one of plant, nb, nf"),
        (OE + "delay: {nk: {a: [3, 1]}}", "datasets.a.delay.nk", "above the upper one"),
        (
            "output: [2, 3]\n    orders: {nb: 2}",
            "datasets.a.orders.nb",
            "give one of nx",
        ),
        ("output_unit: [m, s]", "datasets.a.output_unit", "2 values and 1 outputs"),
        (
            "output: [2, 3]\n    split: {estimation: 1.0}",
            "datasets.a.split.estimation",
            "none are left",
        ),
        (
            "output: [acc, y]" + GEOMETRY.replace("point: tip", "point: top"),
            "datasets.a.geometry.channels.acc",
            "there is no point top",
        ),
        (
            "output: [acc, y]" + GEOMETRY.replace("-x", "[0, 0, 0]"),
            "datasets.a.geometry.channels.acc.direction",
            "has no length",
        ),
        (
            "output: [acc, y]" + GEOMETRY.replace("-x", "up"),
            "datasets.a.geometry.channels.acc.direction",
            "x, y, z",
        ),
    ],
)
def test_misuse_is_refused_in_one_sentence(keys, place, says):
    message = refusal(keys)
    assert f" {place}: " in message or f"{place} " in message or place in message
    assert says in message


def test_a_structure_of_the_defaults_is_named():
    assert "defaults.structure: a polynomial model has one output" in refusal(
        "output: [2, 3]", "{structure: oe}"
    )


def test_a_cell_of_a_table_may_hold_a_list(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("table.csv").write_text('name,file,output\na,a.csv,"[acc, 3]"\nb,b.csv,[V]\n')
    found = complete({"datasets": "table.csv"}).datasets
    assert found["a"].source.channels.outputs == ("acc", 3)
    assert found["b"].source.channels.outputs == ("[V]",)
