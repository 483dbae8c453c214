"""Disturbances: nothing but settings, inside their ranges, and free to combine."""

from itertools import combinations

import pytest

from sim.disturbances import DISTURBANCES, disturbed, parse_disturbances
from sim.settings import RecordSettings
from vo.contract.errors import SettingsError

PLAIN = RecordSettings()


def test_parse_disturbances_reads_names_and_strengths():
    assert parse_disturbances("blur, brick_bump=0.5,slip=2") == {
        "blur": 1.0,
        "brick_bump": 0.5,
        "slip": 2.0,
    }
    assert parse_disturbances("") == {}


def test_unknown_disturbance_lists_the_valid_ones():
    with pytest.raises(SettingsError, match="unknown disturbance smog; valid: blur, brick_bump,"):
        parse_disturbances("blur,smog=2")


@pytest.mark.parametrize("strength", ["much", "-1", "nan", "inf", ""])
def test_strength_below_zero_or_no_number_is_refused(strength):
    with pytest.raises(SettingsError, match="disturbance blur: strength"):
        parse_disturbances(f"blur={strength}")


@pytest.mark.parametrize("name", DISTURBANCES)
def test_disturbed_strength_zero_changes_nothing(name):
    assert disturbed(PLAIN, {name: 0.0}) == PLAIN


@pytest.mark.parametrize("name", DISTURBANCES)
@pytest.mark.parametrize("strength", [0.01, 0.1, 0.5, 1.0, 2.0])
def test_recipes_stay_inside_the_settings_ranges(name, strength):
    changed = disturbed(PLAIN, {name: strength})
    assert changed != PLAIN
    assert RecordSettings.model_validate(changed.model_dump()) == changed


@pytest.mark.parametrize(
    "key",
    ["terrain.brick_mm", "exposure.time_ms", "rover.flex_deg", "sensor.softness_px", "noise"],
)
def test_disturbed_stronger_changes_more(key):
    name = {
        "terrain.brick_mm": "brick_bump",
        "exposure.time_ms": "blur",
        "rover.flex_deg": "mast_flex",
        "sensor.softness_px": "defocus",
    }.get(key, "noise")

    def size(strength: float) -> float:
        settings = disturbed(PLAIN, {name: strength})
        if key == "noise":  # electrons of read noise by those of the well, and shot noise
            sensor = settings.sensor
            assert sensor.read_noise / sensor.full_well < sensor.full_well**-0.5
            return sensor.full_well**-0.5
        group, field = key.split(".")
        return getattr(getattr(settings, group), field)

    assert size(2.0) == pytest.approx(2 * size(1.0))
    assert size(0.5) == pytest.approx(size(1.0) / 2)


@pytest.mark.parametrize("names", list(combinations(DISTURBANCES, 2)), ids="+".join)
def test_disturbed_pairs_combine(names):
    both = disturbed(PLAIN, dict.fromkeys(names, 1.0)).model_dump()
    for name in names:
        alone = disturbed(PLAIN, {name: 1.0}).model_dump()
        for key in DISTURBANCES[name].recipe:
            group, field = key.split(".")
            assert both[group][field] >= alone[group][field]


def test_disturbed_same_key_takes_the_larger_value():
    bumpy, blurred = (disturbed(PLAIN, {name: 1.0}) for name in ("brick_bump", "blur"))
    for strength in (0.5, 1.5):
        both = disturbed(PLAIN, {"blur": strength, "brick_bump": 1.0})
        blur_ms = strength * blurred.exposure.time_ms
        assert both.exposure.time_ms == max(blur_ms, bumpy.exposure.time_ms)
        assert both.terrain == bumpy.terrain
        assert disturbed(PLAIN, {"brick_bump": 1.0, "blur": strength}) == both


def test_disturbed_out_of_range_names_the_setting():
    with pytest.raises(SettingsError, match=r"terrain\.brick_mm"):
        disturbed(PLAIN, {"brick_bump": 5.0})
    with pytest.raises(SettingsError, match=r"exposure\.time_ms .* takes .* ms, but"):
        disturbed(PLAIN, {"blur": 5.0})
