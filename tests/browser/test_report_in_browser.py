"""The pages in a real browser: nothing asked from outside, nothing complained about, the right numbers shown."""

from dataclasses import replace

import numpy as np
import pytest

HOSTILE = "</script><script>window.hit=1</script><img src=x onerror='window.hit=1'>"
# Shares of distinct colours on a canvas: one colour means that nothing was drawn.
COLOURS = """[...document.querySelectorAll("canvas")].map((canvas) => {
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  const seen = new Set();
  for (let i = 0; i < data.length; i += 4 * 97) seen.add(data[i] * 65536 + data[i + 1] * 256 + data[i + 2]);
  return seen.size;
})"""


def only_own(requests, path):
    return all(url == path.as_uri() or url.startswith(("data:", "blob:", "about:")) for url in requests)


def choose(browser, role, value, index=0):
    browser.run(
        f"""(() => {{
        const select = document.querySelectorAll('[data-role="{role}"]')[{index}];
        select.value = "{value}";
        for (const kind of ["input", "change"]) select.dispatchEvent(new Event(kind, {{ bubbles: true }}));
        }})()"""
    )
    browser.settle()


def corner(browser, selector):
    box = f"document.querySelector('{selector}').getBoundingClientRect()"
    return browser.run(f"[{box}.left, {box}.top]")


def text(browser, role):
    return browser.run(f"document.querySelector('[data-role=\"{role}\"]').innerText").replace("\u200b", "")


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, False), (1280, True)])
def test_report_draws_without_a_word_and_without_overflow(browser, report_file, width, dark):
    browser.open(report_file, width, 844, dark)
    assert browser.complaints() == []
    assert only_own(browser.requests(), report_file)
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert min(browser.run(COLOURS)) > 5
    clipped = browser.run(
        """[...document.querySelectorAll("svg text")].filter((one) => {
        const own = one.getBoundingClientRect(), box = one.ownerSVGElement.getBoundingClientRect();
        const inside = own.left > box.left - 1 && own.right < box.right + 1;
        return !(inside && own.top > box.top - 1 && own.bottom < box.bottom + 1);
        }).map((one) => one.textContent)"""
    )
    assert clipped == []


def test_policy_blocks_a_request_that_a_script_tries(browser, report_file):
    browser.open(report_file)
    tried = browser.run('fetch("http://127.0.0.1:9/").then(() => "sent", () => "refused")')
    assert tried == "refused"
    browser.settle()
    assert any("Content Security Policy" in word for word in browser.complaints())


def test_readout_under_the_cursor_is_the_cell_of_the_map(browser, report_file, synthetic_run):
    browser.open(report_file)
    surface = synthetic_run.report_content().maps[0].surface
    browser.run('document.querySelector("[data-role=heat]").scrollIntoView({ block: "center", behavior: "instant" })')
    browser.settle()
    left, top = corner(browser, "[data-role=heat]")
    browser.move(left + 120, top + 60)
    place = [
        float(part.split("=")[1].replace("mm", "").replace("−", "-"))
        for part in text(browser, "readout").splitlines()[0].split(",")
    ]
    column = int(np.abs(1000 * surface.grid.u_m - place[0]).argmin())
    row = int(np.abs(1000 * surface.grid.v_m - place[1]).argmin())
    # Up on the screen is up on the part, right is right.
    assert place[0] < -50
    assert place[1] > 150
    height = f"{1000 * surface.height_m[row, column]:.2f}".replace("-", "−")
    assert height in text(browser, "readout").replace("\n", "\t").split("\t")
    assert "us0" in text(browser, "readout")


def test_arrow_keys_move_by_one_cell_and_the_cut_follows(browser, report_file):
    browser.open(report_file)
    before = text(browser, "at-v")
    browser.run('document.querySelector("[data-role=heat]").focus()')
    for kind in ("keyDown", "keyUp"):
        browser.ask("Input.dispatchKeyEvent", type=kind, key="ArrowUp", code="ArrowUp", windowsVirtualKeyCode=38)
    browser.settle()
    after = text(browser, "at-v")
    assert float(after.split()[0]) - float(before.split()[0]) == pytest.approx(10.0, abs=0.11)
    label = browser.run('document.querySelector("[data-role=cut-u] svg").getAttribute("aria-label")')
    assert after.split()[0] in label


@pytest.mark.parametrize(
    "layer", ["error", "sigma", "confidence", "count", "regime", "stop-dc", "stop-dc1", "stop-gate", "stop-depth"]
)
def test_every_layer_draws(browser, report_file, layer):
    browser.open(report_file)
    choose(browser, "layer", layer)
    if layer == "stop-gate":
        choose(browser, "sensor", "0")
        assert "us0" in text(browser, "caption")
    assert browser.complaints() == []
    assert browser.run(COLOURS.replace('"canvas"', '"canvas[data-role=heat]"'))[0] > 3


def test_two_methods_stand_side_by_side_with_bands_and_second_surfaces(browser, report_file):
    browser.open(report_file)
    host = "document.querySelector('[data-side-by-side]')"
    captions = browser.run(f"[...{host}.querySelectorAll('figcaption strong')].map((one) => one.textContent)")
    assert [text.replace("\u200b", "") for text in captions[:3]] == ["fused (weighted_average)", "sharp", "truth"]
    assert browser.run(f"{host}.querySelectorAll('svg .band').length") == 4
    assert browser.run(f"{host}.querySelectorAll('svg .second').length") > 0
    assert browser.run(f"{host}.querySelectorAll('svg .guessed').length") > 0
    assert "prior only" in browser.run(f"{host}.innerText")
    choose(browser, "cut-of", "error")
    browser.run(f"{host}.querySelector('[data-role=own-scale]').click()")
    browser.settle()
    assert "scale ±" in browser.run(f"{host}.innerText")
    assert browser.complaints() == []


def test_surfaces_and_colours_of_the_relief_switch(browser, report_file):
    browser.open(report_file)
    before = browser.run('document.querySelector("[data-role=relief]").toDataURL().length')
    choose(browser, "relief-map", "2")
    choose(browser, "relief-colour", "error")
    assert browser.run('document.querySelector("[data-role=relief-colour]").value') == "error"
    assert browser.run('document.querySelector("[data-role=relief]").toDataURL().length') != before
    assert browser.complaints() == []


def test_replay_starts_in_the_page_and_asks_nothing_from_outside(browser, report_file):
    browser.open(report_file)
    browser.run('document.querySelector("#replay").scrollIntoView({ behavior: "instant" })')
    browser.run('document.querySelector("[data-role=play]").click()')
    found = browser.run(
        """new Promise((done) => {
        const end = Date.now() + 20000;
        const look = () => {
          const frame = document.querySelector("#replay iframe");
          const drawn = frame && frame.contentDocument && frame.contentDocument.querySelector("canvas");
          if (drawn) done("canvas"); else if (Date.now() > end) done("nothing"); else setTimeout(look, 200);
        };
        look();
        })"""
    )
    assert found == "canvas"
    assert only_own(browser.requests(), report_file)
    assert browser.complaints() == []


def test_hostile_names_do_nothing(browser, synthetic_run, tmp_path):
    from surfuse.report.page import PageLimits, render_report

    content = synthetic_run.report_content()
    specs = tuple(replace(spec, name=HOSTILE) for spec in content.readings.specs)
    attacked = replace(
        content,
        title=HOSTILE,
        maps=tuple(replace(one, label=HOSTILE) for one in content.maps),
        readings=replace(content.readings, specs=specs),
        configuration_toml=HOSTILE,
    )
    path = tmp_path / "hostile #1?.html"
    path.write_text(render_report(attacked, PageLimits(replay=False)), encoding="utf-8")
    browser.open(path)
    choose(browser, "layer", "stop-dc")
    assert browser.run("window.hit === undefined")
    assert browser.run('document.querySelectorAll("img").length') == 0
    assert HOSTILE in text(browser, "readout")
    assert browser.complaints() == []


def test_a_map_alone_makes_a_working_page(browser, synthetic_run, tmp_path):
    from surfuse.report.content import ReportContent
    from surfuse.report.page import render_report

    path = tmp_path / "map.html"
    path.write_text(
        render_report(ReportContent(title="map", maps=synthetic_run.report_content().maps[:1])), encoding="utf-8"
    )
    browser.open(path)
    assert browser.complaints() == []
    assert min(browser.run(COLOURS)) > 5


@pytest.mark.parametrize("width", [1280, 390])
def test_comparison_shares_one_cursor_and_one_scale(browser, comparison_file, width):
    browser.open(comparison_file, width)
    assert browser.complaints() == []
    assert only_own(browser.requests(), comparison_file)
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert min(browser.run(COLOURS)) > 3
    assert browser.run('document.querySelectorAll("[data-comparison]").length') == 3
    assert browser.run('document.querySelectorAll("[data-role=cut] svg").length') == 3
    browser.run('document.querySelector(".multiples canvas").scrollIntoView({ block: "center", behavior: "instant" })')
    values = '[...document.querySelectorAll("[data-comparison] .value")].slice(0, 6).map((one) => one.textContent)'
    before = browser.run(values)
    left, top = corner(browser, ".multiples canvas")
    browser.move(left + 60, top + 20)
    after = browser.run(values)
    assert all(one != other for one, other in zip(before, after, strict=True))
    assert after[5] == "0.00 mm"
