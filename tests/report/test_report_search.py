"""The search section: thresholds named, the outline with a band as wide as its uncertainty, one block a part."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from surfuse.records import Outline
from surfuse.report.content import FoundPartView, MarkedLevel
from surfuse.report.outline_drawing import outline_chart
from surfuse.report.search_drawing import histogram_chart
from surfuse.report.search_section import search_section

SQUARE = np.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
SIGMA = np.array([0.001, 0.002, 0.003, 0.004])
LEVELS = (MarkedLevel("otsu", 100, 0.98), MarkedLevel("maximum_entropy", 140, 0.5))


def part(label="part 1", **more):
    return FoundPartView(
        label, np.zeros((20, 30), np.uint8), histogram=np.arange(256), threshold=99, levels=LEVELS, **more
    )


def text_of(markup):
    return re.sub(r"<[^>]+>", " ", str(markup))


def circles(chart):
    return [float(one.get("r")) for one in ET.fromstring(str(chart)).iter("circle")]


def test_band_is_two_standard_deviations_wide_on_the_scale_of_the_axes():
    chart = outline_chart(Outline(SQUARE, np.eye(4), sigma_m=SIGMA), "it")
    radii = circles(chart)
    dots = re.search(r'd="([^"]+)" class="corners"', str(chart)).group(1)
    x = [float(value) for value in re.findall(r"M([-\d.]+) ", dots)]
    per_mm = (x[1] - x[0]) / 200.0
    assert radii == pytest.approx(2.0 * 1e3 * SIGMA * per_mm, abs=0.02)


def test_without_uncertainty_there_is_no_band():
    chart = outline_chart(Outline(SQUARE, np.eye(4)), "it")
    assert circles(chart) == []
    assert 'class="rim"' in str(chart)


def test_holes_are_drawn():
    hole = 0.5 * SQUARE + [0.0, 0.05]
    chart = outline_chart(Outline(SQUARE, np.eye(4), holes_m=(hole,)), "it")
    assert str(chart).count('class="rim"') == 2


def test_every_threshold_is_marked_and_named():
    chart = str(histogram_chart(part()))
    assert [one.text for one in ET.fromstring(chart).iter("title")] == ["otsu", "maximum_entropy", "threshold 99"]
    section = text_of(search_section((part(),), 300))
    for word in ("otsu", "100", "0.98", "maximum_entropy", "140", "0.50"):
        assert word in section


def test_one_block_a_part_with_its_own_facts():
    outline = Outline(SQUARE, np.eye(4), sigma_m=SIGMA)
    one = part("part 1", outline=outline, facts=("camera at 35.0°",))
    two = replace(one, label="part <2>", facts=("camera at 70.0°",), outline=None)
    section = search_section((one, two), 300)
    assert str(section).count("<article>") == 2
    words = text_of(section)
    assert "The 2 parts, in order of angle" in words
    assert "camera at 35.0°" in words
    assert "camera at 70.0°" in words
    assert "200 × 200 mm; standard deviation of a vertex 1.0 to 4.0 mm" in words
    assert "<2>" not in str(section)
