"""Noise, softness and vignetting of a simulated camera are found again from its images."""

import pytest
from recovery import recovered

pytestmark = [pytest.mark.gl, pytest.mark.slow]


def test_camera_of_a_simulated_recording_is_found_again(tmp_path):
    scene, found = recovered(35, 24, tmp_path)
    assert all(x.is_near for x in found), (scene, [x.text for x in found])
    assert not any(x.estimate.value == x.truth for x in found)  # equal would betray the truth
