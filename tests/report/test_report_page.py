import itertools
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from surfuse.errors import ConfigError, DataError, StorageError
from surfuse.records import GuardReason, RegionDecision, SkippedStop
from surfuse.report.comparison import render_comparison
from surfuse.report.content import SAFETY, KeyFigure, PageTable, ReportContent, ReportEvent
from surfuse.report.page import PageLimits, render_report
from surfuse.report.skeleton import POLICY, write_page

HOSTILE = "</script><script>window.hit=1</script><img src=x onerror='window.hit=1'>\"'&"
LIGHT = PageLimits(replay=False)


class Page(HTMLParser):
    """Elements, texts and what an HTML page would load; scripts are read as the browser reads them."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.elements, self.scripts, self.text, self.inside = [], [], "", ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self.inside = tag
            self.scripts.append((dict(attrs).get("id", tag), ""))

    def handle_endtag(self, tag):
        if tag == self.inside:
            self.inside = ""

    def handle_data(self, data):
        if self.inside:
            name, text = self.scripts[-1]
            self.scripts[-1] = (name, text + data)
        else:
            self.text += data

    def ids(self):
        return {attributes["id"] for _, attributes in self.elements if "id" in attributes}

    def script(self, name):
        return next(text for found, text in self.scripts if found == name)


@pytest.fixture(scope="module")
def whole(run_content):
    return render_report(run_content)


@pytest.fixture(scope="module")
def page(whole):
    return Page(whole)


SECTIONS = {
    "methods",
    "surface",
    "maps",
    "scores",
    "replay",
    "search",
    "plan",
    "gaps",
    "events",
    "configuration",
    "about",
}


def test_a_whole_run_fits_into_two_megabytes(whole):
    assert len(whole.encode()) < 2.0e6


def test_a_whole_run_has_every_section_and_each_is_in_the_contents(page):
    assert page.ids() >= SECTIONS
    links = {attributes["href"] for tag, attributes in page.elements if tag == "a"}
    assert links == {f"#{name}" for name in SECTIONS}


def test_nothing_is_loaded_from_outside(page):
    loading = {"src", "href", "data", "poster", "srcset", "action", "formaction", "xlink:href"}
    for tag, attributes in page.elements:
        for name, value in attributes.items():
            if name in loading:
                assert value.startswith(("#", "data:image/")), (tag, name, value)
        assert "url(" not in attributes.get("style", "")
    assert "@import" not in page.script("style")
    assert "url(" not in page.script("style")


def test_the_browser_is_told_to_refuse_outside_addresses(page):
    policies = [a["content"] for tag, a in page.elements if a.get("http-equiv") == "Content-Security-Policy"]
    assert policies == [POLICY]
    assert POLICY.startswith("default-src 'none'")
    assert not re.search(r"https?:|\*|'self'", POLICY)


def test_own_scripts_name_no_address_but_the_svg_namespace(page):
    own = page.scripts[-1][1]
    assert set(re.findall(r"https?://[^\"'\s]+", own)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"\bfetch\(|XMLHttpRequest|WebSocket|innerHTML|eval\(", own)


def test_the_recording_survives_its_wrapping(page):
    text = page.script("recording").replace("\x01", "<")
    assert text.startswith("<!doctype html>")
    assert text.rstrip().endswith("</html>")
    assert "__VISER_EMBED_DATA__" in text


def test_the_safety_statement_is_on_every_page(page, several_methods):
    assert SAFETY in page.text
    assert SAFETY in Page(render_report(ReportContent(title="x"))).text
    assert SAFETY in Page(render_comparison(several_methods)).text


def test_headings_do_not_skip_a_level_and_pictures_have_words(page):
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
    for tag, attributes in page.elements:
        if tag in ("svg", "canvas"):
            assert attributes.get("aria-label") or attributes.get("aria-hidden") == "true"


def test_a_title_alone_makes_a_page():
    page = Page(render_report(ReportContent(title="only this")))
    assert "only this" in page.text
    assert not page.ids() & (SECTIONS - {"about"})
    assert json.loads(page.script("surfuse-data"))["groups"] == []


@pytest.mark.parametrize(
    ("gone", "section"),
    [
        ({"parts": ()}, "search"),
        ({"plan": None}, "plan"),
        ({"scores": ()}, "scores"),
        ({"events": ()}, "events"),
        ({"configuration_toml": ""}, "configuration"),
        ({"points": None}, "gaps"),
        ({"maps": (), "rival": None}, "maps"),
    ],
)
def test_a_section_without_content_is_left_out(run_content, gone, section):
    ids = Page(render_report(replace(run_content, **gone), LIGHT)).ids()
    assert section not in ids
    assert len(ids & SECTIONS) >= len(SECTIONS) - 4


def test_a_foreign_log_without_camera_truth_and_arm(run_content):
    content = ReportContent(
        title="log.csv", maps=run_content.maps[:1], points=run_content.points, readings=run_content.readings
    )
    page = Page(render_report(content))
    assert page.ids() >= {"surface", "maps", "replay", "gaps"}
    layers = json.loads(page.script("surfuse-data"))["groups"][0]["maps"][0]["layers"]
    assert "error" not in layers


def hostile(content):
    named = tuple(replace(one, label=HOSTILE) for one in content.maps)
    specs = tuple(replace(spec, name=HOSTILE) for spec in content.readings.specs)
    return replace(
        content,
        title=HOSTILE,
        scene=HOSTILE,
        method=HOSTILE,
        made=HOSTILE,
        version=HOSTILE,
        summary=HOSTILE,
        figures=(KeyFigure(HOSTILE, HOSTILE, HOSTILE),),
        parts=(replace(content.parts[0], label=HOSTILE),),
        plan=replace(content.plan, skipped=(SkippedStop(0.0, 0.0, HOSTILE),)),
        maps=named,
        truth=replace(content.truth, label=HOSTILE),
        readings=replace(content.readings, specs=specs),
        scores=tuple(replace(row, method=HOSTILE) for row in content.scores),
        events=(ReportEvent(HOSTILE, "error", 1.0),),
        configuration_toml=HOSTILE,
        safety=HOSTILE,
    )


def test_hostile_names_stay_text(run_content, page):
    attacked = Page(render_report(hostile(run_content)))
    allowed = [tag for tag, _ in page.elements if tag in ("script", "img")]
    assert [tag for tag, _ in attacked.elements if tag in ("script", "img")] == allowed
    assert not any(name.startswith("on") for _, attributes in attacked.elements for name in attributes)
    assert attacked.text.count(HOSTILE) > 12
    data = json.loads(attacked.script("surfuse-data"))["groups"][0]
    assert data["maps"][0]["label"] == data["stops"]["sensors"][0] == HOSTILE


def test_hostile_names_stay_text_in_a_comparison(several_methods):
    scenes = tuple(
        replace(
            scene,
            name=HOSTILE,
            expected=HOSTILE,
            found=HOSTILE,
            maps=tuple(replace(one, label=HOSTILE) for one in scene.maps),
        )
        for scene in several_methods.scenes
    )
    clean, attacked = (
        Page(render_comparison(several_methods)),
        Page(render_comparison(replace(several_methods, scenes=scenes, title=HOSTILE, introduction=HOSTILE))),
    )
    assert len(attacked.elements) == len(clean.elements)


def test_tables_of_texts_stand_behind_the_scenes_and_stay_text(several_methods):
    table = PageTable("Constants", ("constant", "error"), (("change_m", "0.72"), (HOSTILE, HOSTILE)), "What it says.")
    page = Page(render_comparison(replace(several_methods, tables=(table,))))
    for text in ("Constants", "change_m", "0.72", "What it says."):
        assert text in page.text
    calm = replace(table, rows=(("change_m", "0.72"), ("a", "b")))
    assert len(page.elements) == len(Page(render_comparison(replace(several_methods, tables=(calm,)))).elements)
    with pytest.raises(DataError, match="1 cells under 2 heads"):
        replace(table, rows=(("alone",),))


def test_best_figures_stand_out_and_a_column_without_figures_is_left_out(run_content, synthetic):
    cells = re.findall(r'<td class="best">([^<]*)</td>', render_report(run_content, LIGHT))
    assert cells == ["3.100", "3.410", "2.046", "1.860", "−0.100", "6.820", "4.2"]
    alone = replace(run_content, scores=(replace(run_content.scores[0], dense=synthetic.dense(0.012, float("nan"))),))
    text = Page(render_report(alone, LIGHT)).text
    assert "edge off by" not in text
    assert "12.410" in text


def test_the_rival_stands_beside_the_run_with_evidence_in_words(page, run_content):
    group = json.loads(page.script("surfuse-data"))["groups"][0]
    (pair,) = (a["data-pair"] for _, a in page.elements if "data-pair" in a)
    labels = [group["maps"][k]["label"] for k in json.loads(pair)]
    assert labels == [run_content.maps[0].label, "sharp"]
    assert {"second", "weight"} <= set(group["maps"][json.loads(pair)[1]]["layers"])
    assert page.text.count("prior only, not measured") == 1
    assert "No reading holds the cell" in page.text


def test_the_decisions_of_the_guard_are_told_in_words(run_content):
    best = RegionDecision(
        (-0.1, 0.0), (0.0, 0.2), 40, 9, ("own", "plane"), "own", GuardReason.BEST, (0.001, 0.004), (0.0, 0.0)
    )
    beaten = replace(best, chosen="plane", reason=GuardReason.BEATEN, miss_m=(0.006, 0.002))
    first = run_content.maps[0]
    judged = replace(first, surface=replace(first.surface, decisions=(best, beaten)))
    page = Page(render_report(replace(run_content, maps=(judged, *run_content.maps[1:])), LIGHT))
    assert "of 2 regions own in 1, plane in 1" in page.text
    assert "predicts them clearly better than the method's own" in page.text
    assert page.text.index("6.00") < page.text.index("4.00")
    assert "How the surface was chosen" not in Page(render_report(run_content, LIGHT)).text


def test_a_run_alone_is_shown_without_a_rival(run_content):
    page = Page(render_report(replace(run_content, rival=None), LIGHT))
    assert [a["data-pair"] for _, a in page.elements if "data-pair" in a] == ["[0]"]
    with pytest.raises(DataError, match="beside no map"):
        replace(run_content, maps=())


def test_thinning_is_said(run_content, synthetic):
    text = Page(render_report(run_content, replace(LIGHT, map_nodes_max=800))).text
    assert "one in" in text
    assert "surface.nc has all of them" in text
    assert "one in" not in Page(render_report(run_content, LIGHT)).text


def test_a_large_map_and_a_long_log_stay_below_the_limit(synthetic):
    rng = np.random.default_rng(5)
    fine = synthetic.NamedMap("fine", synthetic.surface(0.0005, 0.03, 1e-4, "fine", rng))
    readings, points = synthetic.scan(rng, step_m=0.002)
    assert len(readings.range_m) > 40000
    content = ReportContent(title="large", maps=(fine,) * 6, points=points, readings=readings)
    text = render_report(content)
    assert len(text.encode()) < 2.2e6


def test_comparison_holds_all_maps_of_all_scenes(several_methods):
    text = render_comparison(several_methods)
    page = Page(text)
    groups = json.loads(page.script("surfuse-data"))["groups"]
    assert [len(group["maps"]) for group in groups] == [6, 6, 6]
    assert page.ids() >= {"scene-1", "scene-2", "scene-3", "configuration", "about"}
    assert all(scene.expected in page.text and scene.found in page.text for scene in several_methods.scenes)
    assert len(text.encode()) < 1e6


def test_same_content_same_page(run_content):
    assert render_report(run_content, LIGHT) == render_report(run_content, LIGHT)


def test_limits_are_checked():
    with pytest.raises(ConfigError, match="images_px = 1"):
        PageLimits(images_px=1)


def test_pages_are_replaced_whole(tmp_path):
    path = tmp_path / "report.html"
    write_page(path, "old")
    write_page(path, "new ·")
    assert path.read_text(encoding="utf-8") == "new ·"
    assert [one.name for one in tmp_path.iterdir()] == ["report.html"]


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(StorageError, match="nowhere"):
        write_page(tmp_path / "nowhere" / "report.html", "x")
