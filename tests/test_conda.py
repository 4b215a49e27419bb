"""The conda recipe asks for what the package needs; rattler-build builds it, installs it and runs its tests."""

import re
import sys
import tomllib
from pathlib import Path

import pytest
from rattler_build import Package, Stage0Recipe, ToolConfiguration

ROOT = Path(__file__).parents[1]
RECIPE = ROOT / "conda/recipe.yaml"
ABOUT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_recipe_asks_for_what_the_package_needs():
    """Of the same versions; OpenCV has another name there."""
    (variant,) = Stage0Recipe.from_file(RECIPE).render()
    recipe = variant.recipe.to_dict()
    assert (recipe["package"]["name"], recipe["package"]["version"]) == (ABOUT["name"], ABOUT["version"])
    wanted = [re.sub("^opencv-python-headless", "py-opencv", one) for one in ABOUT["dependencies"]]
    wanted.append(f"python{ABOUT['requires-python']}")
    assert {one.replace(" ", "") for one in recipe["requirements"]["run"]} == set(wanted)
    (entry,) = recipe["build"]["python"]["entry_points"]
    assert entry == f"jaxsim = {ABOUT['scripts']['jaxsim']}"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the channel of what runs here is made on Linux alone")
def test_the_recipe_is_built_and_what_it_builds_runs_outside_any_checkout(tmp_path):
    """Its own tests import it, print its help and ask the doctor, in a new environment of the channel's packages."""
    from tests.conda_channel import make_channel

    names = [re.split("[<>=]", one)[0] for one in ABOUT["dependencies"]]
    make_channel(tmp_path, [*names, "pip", "hatchling"])
    channels, quiet = [tmp_path.as_uri()], ToolConfiguration(test_strategy="skip")
    (built,) = Stage0Recipe.from_file(RECIPE).run_build(output_dir=tmp_path, channels=channels, tool_config=quiet)
    package = Package.from_file(built.packages[0])
    assert (package.noarch, package.name) == ("python", ABOUT["name"])
    for needed in ("generator.npz", "kitti_raw.py"):  # a network and an experiment travel with it
        assert any(Path(str(file)).name == needed for file in package.files)
    results = [package.run_test(number, channel=channels) for number in range(package.test_count)]
    assert len(results) == 2
    assert all(result.success for result in results), [result.output for result in results]
    assert any(line.startswith("jaxsim:") for line in results[1].output)
