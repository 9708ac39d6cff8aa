"""The controls of the pages in a real browser: copying, sorting, searching and saving."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import pytest
from browsing import TEMPLATES, needs_chromium, visit

from evopem.config.structures import ORDER_NAMES
from evopem.report.index_page import build_index
from evopem.results.layout import FIGURES

pytest.importorskip("selenium", reason="selenium is not installed")
pytestmark = needs_chromium


def copied(browser):
    """Text on the clipboard."""
    browser.execute_cdp_cmd(
        "Browser.grantPermissions",
        {"permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]},
    )
    return browser.execute_async_script(
        """const done = arguments[arguments.length - 1];
        (window.clipboard ?? navigator.clipboard).readText().then(done, e => done(String(e)))"""
    )


def press(browser, label):
    """Press the button of that name by keyboard and wait until it has said what it did."""
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import WebDriverWait

    button = browser.find_element("css selector", f'button[aria-label="{label}"]')
    button.send_keys(Keys.ENTER)
    WebDriverWait(browser, 5).until(lambda _: button.text == "Copied")
    assert "copied" in browser.find_element("id", "status").get_attribute("textContent")


@pytest.mark.parametrize("clipboard", ["granted", "absent", "refused"])
def test_the_model_is_copied_in_every_notation(browser, report, identified, clipboard):
    visit(browser, report)
    if clipboard != "granted":
        value = {
            "absent": "undefined",
            "refused": "{writeText: () => Promise.reject(new Error('no'))}",
        }[clipboard]
        browser.execute_script(
            "window.clipboard = navigator.clipboard;"
            f"Object.defineProperty(navigator, 'clipboard', {{value: {value}}})"
        )
    model = json.loads(Path(identified.files.model).read_text())
    press(browser, "Copy JSON")
    taken = json.loads(copied(browser))
    assert taken["orders"] == model["orders"]
    of_model = {name: taken[name] for name in ("noise_variance", "sampling_rate")}
    of_model |= {"A": taken["a"], "B": [taken["b"]], "C": taken["c"]}
    assert model["model"] | of_model == model["model"]
    assert set(taken) == {"orders", "a", "b", "c", "noise_variance", "sampling_rate"}
    assert {"orders", "a", "b", "c", "noise_variance", "sampling_rate"} == set(taken)
    press(browser, "Copy Plain text")
    assert copied(browser).startswith("A(q) y(t) = B(q) u(t) + C(q) e(t)\nA(q) = 1 ")
    press(browser, "Copy MATLAB")
    assert copied(browser).startswith("model = idpoly([1 ")
    press(browser, "Copy Python")
    assert "control.tf(" in copied(browser)


def test_a_table_is_copied_with_numbers_at_full_precision(browser, report, results):
    visit(browser, report)
    press(browser, "Copy table: Modes")
    header, *rows = [line.split("\t") for line in copied(browser).split("\n")]
    assert header[:5] == [
        "Mode",
        "fn (Hz)",
        "fn (Hz) standard error",
        "zeta (%)",
        "zeta (%) standard error",
    ]
    assert {len(row) for row in rows} == {len(header)}
    for row, mode in zip(rows, results.model.modes, strict=True):
        assert float(row[1]) == pytest.approx(mode.frequency_hz, rel=1e-11)
        assert float(row[4]) == pytest.approx(100 * mode.damping_se, rel=1e-11)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    press(browser, "Copy table: Time of each stage")
    assert "\u202f" not in copied(browser)


def column(browser, table, index):
    return browser.execute_script(
        """return Array.from(document.querySelector(`table[data-name="${arguments[0]}"]`)
            .tBodies[0].rows).map(row => row.cells[arguments[1]]?.dataset.value ??
                row.cells[arguments[1]]?.textContent ?? '')""",
        table,
        index,
    )


def test_tables_sort_by_keyboard(browser, report):
    from selenium.webdriver.common.keys import Keys

    visit(browser, report)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    heads = browser.find_elements("css selector", 'table[data-name="Candidates"] thead th')
    bic = next(i for i, head in enumerate(heads) if head.text.startswith("BIC"))
    button = heads[bic].find_element("tag name", "button")
    before = [float(value) for value in column(browser, "Candidates", bic)]
    button.send_keys(Keys.ENTER)
    assert [float(v) for v in column(browser, "Candidates", bic)] == sorted(before)
    assert heads[bic].get_attribute("aria-sort") == "ascending"
    button.send_keys(Keys.SPACE)
    assert [float(v) for v in column(browser, "Candidates", bic)] == sorted(before, reverse=True)
    assert heads[bic].get_attribute("aria-sort") == "descending"
    assert "descending" in browser.find_element("id", "status").get_attribute("textContent")
    heads[0].find_element("tag name", "button").send_keys(Keys.ENTER)
    assert heads[bic].get_attribute("aria-sort") is None
    words = column(browser, "Candidates", 0)
    assert words == sorted(words)


def test_what_has_no_number_stays_at_the_end(browser, report):
    visit(browser, report)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    button = browser.find_element(
        "xpath", '//table[@data-name="Time of each stage"]//button[text()="Evaluations"]'
    )
    for reverse in (False, True):
        button.click()
        values = column(browser, "Time of each stage", 2)
        numbers = [float(value) for value in values if value]
        assert numbers == sorted(numbers, reverse=reverse)
        assert values == [v for v in values if v] + [""] * (len(values) - len(numbers))


def test_a_thousand_data_sets_are_searched_and_sorted(browser, thousand):
    """The worst stand first; a search leaves the rows that hold all its words."""
    visit(browser, thousand)
    names = column(browser, "Data sets", 0)
    errors = [float(value) for value in column(browser, "Data sets", 2) if value]
    assert names[0] == "bench-999"
    assert errors == sorted(errors, reverse=True)
    assert len(errors) == 999

    def shown(words):
        return browser.execute_script(
            """const field = document.querySelector('input[type=search]');
            field.value = arguments[0];
            field.dispatchEvent(new Event('input', {bubbles: true}));
            const rows = [...document.querySelector('tbody').rows].filter(row => !row.hidden);
            return rows.map(row => row.cells[0].textContent);""",
            words,
        )

    assert set(shown("BENCH-99 passed")) == {
        "bench-99",
        *(f"bench-99{digit}" for digit in range(9)),
    }
    assert shown("not complete") == ["bench-999"]
    assert "1 of 1000 rows" in browser.find_element("id", "status").get_attribute("textContent")
    assert len(shown("")) == 1000

    browser.find_element("css selector", "thead th button").click()
    assert column(browser, "Data sets", 0) == [f"bench-{number}" for number in range(1000)]


def test_a_figures_numbers_are_saved_from_the_page(browser, report, tmp_path):
    import pandas as pd
    from selenium.webdriver.support.ui import WebDriverWait

    visit(browser, report)
    browser.execute_cdp_cmd(
        "Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)}
    )
    link = browser.find_element("css selector", "#delay a[download]")
    browser.execute_script("arguments[0].click()", link)
    saved = tmp_path / "bench-delay.csv"
    WebDriverWait(browser, 10).until(lambda _: saved.is_file())
    assert list(pd.read_csv(saved))[:6] == list(ORDER_NAMES)
    assert browser.current_url == report.as_uri()


def choose(browser, **fields):
    """Fill in filters and return the names of the rows that are left."""
    return browser.execute_script(
        """for (const [name, value] of Object.entries(arguments[0])) {
            const field = document.querySelector(`[data-filter="${name}"]`);
            field.value = value;
            field.dispatchEvent(new Event('input', {bubbles: true}));
        }
        const rows = [...document.querySelector('tbody').rows].filter(row => !row.hidden);
        return rows.map(row => row.cells[0].textContent);""",
        fields,
    )


def test_data_sets_are_filtered_by_check_group_and_frequency(browser, several):
    visit(browser, several)
    assert set(choose(browser)) == {"arm-1", "arm-2", "bench-1", "bench-2"}
    assert choose(browser, failed="White residuals") == ["arm-2"]
    assert set(choose(browser, failed="", group="bench")) == {"bench-1", "bench-2"}
    assert choose(browser, group="", **{"from": "100", "to": "101"}) == ["bench-1"]
    assert choose(browser, **{"from": "", "to": ""}, text="line 7") == ["bench-2"]
    assert len(choose(browser, text="")) == 4


def test_what_differs_everywhere_forms_no_groups(browser, several, summary, tmp_path):
    visit(browser, several)
    groups = "return [...document.querySelectorAll('.columns option')].map(o => o.textContent)"
    assert browser.execute_script(groups)[:2] == ["Group", "Modes (Hz)"]
    entries = {
        f"day-{day}": replace(
            summary, modes=tuple(replace(mode, frequency_hz=10.0 + day) for mode in summary.modes)
        )
        for day in (1, 2)
    }
    file = tmp_path / "index.html"
    file.write_text(build_index(entries), encoding="utf-8")
    visit(browser, file)
    assert "Model" in browser.execute_script(groups)
    assert "Modes (Hz)" not in browser.execute_script(groups)


@pytest.mark.parametrize(("names", "shown"), [(("arm", "bench"), False), (("arm", "arm-2"), True)])
def test_groups_of_one_data_set_are_no_choice(browser, summary, tmp_path, names, shown):
    file = tmp_path / "index.html"
    entries = dict.fromkeys((*names, "rig"), summary)
    file.write_text(build_index(entries), encoding="utf-8")
    visit(browser, file)
    assert browser.find_element("css selector", "[data-filter=group]").is_displayed() == shown


def test_what_is_seen_of_a_list_is_chosen_marked_and_saved(browser, several):
    visit(browser, several)
    assert len(choose(browser, marked="arm-")) == 4
    marked = browser.find_elements("css selector", "tr.marked th")
    assert {cell.text for cell in marked} == {"arm-1", "arm-2"}
    choose(browser, marked="/m-2$|^arm-2 /")
    assert [row.text for row in browser.find_elements("css selector", "tr.marked th")] == ["arm-2"]
    assert choose(browser, text="/arm-(?!2)/") == ["arm-1"]
    assert choose(browser, text="/arm-(/") == []
    assert len(choose(browser, text="")) == 4
    choose(browser, marked="", group="arm")
    browser.execute_script(
        """window.saved = {};
        HTMLAnchorElement.prototype.click = function () { saved[this.download] = this.href; };
        document.querySelectorAll('details').forEach(d => d.open = true);
        [...document.querySelectorAll('.columns input')].filter(
            box => /Model|Rate/.test(box.parentElement.textContent)).forEach(box => box.click());"""
    )
    settle(browser)
    saved = browser.execute_async_script(
        """for (const button of document.querySelectorAll('.tools button')) {
            if (['CSV', 'SVG', 'PNG', 'CSV of groups'].includes(button.textContent)) button.click();
        }
        setTimeout(() => arguments[0](window.saved), 1000);"""
    )
    table = unquote(saved["data_sets.csv"]).partition(",")[2]
    rows = list(csv.reader(table.splitlines()))
    assert [row[0] for row in rows] == ["Data set", "arm-2", "arm-1"]
    assert "Checks" in rows[0]
    assert "Rate" in rows[0]
    assert not {"Model", "Samples"} & {*rows[0]}
    groups = unquote(saved["groups.csv"]).partition(",")[2]
    (head, row) = csv.reader(groups.splitlines())
    assert head[:3] == ["Group", "Data sets", "With failed checks"]
    assert row[:3] == ["arm", "2", "1"]
    drawing = unquote(saved["checks.svg"])
    assert "Checks of 2 recordings" in drawing
    assert drawing.count("arm-2: White residuals, failed") == 1
    assert "bench" not in drawing
    assert saved["checks.png"].startswith("data:image/png;base64,")


def picture(browser, figure):
    """The canvases of a figure as text."""
    return browser.execute_script(
        "return [...document.querySelectorAll(`#${arguments[0]} canvas`)].map(c => c.toDataURL())",
        figure,
    )


def settle(browser):
    """Wait until what was asked for is painted."""
    browser.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0], 100))")


def bring(browser, figure):
    """Bring a figure to the screen and wait until it is drawn."""
    from selenium.webdriver.support.ui import WebDriverWait

    browser.execute_script("document.getElementById(arguments[0]).scrollIntoView()", figure)
    WebDriverWait(browser, 10).until(
        lambda _: browser.find_elements("css selector", f"#{figure} canvas")
    )
    settle(browser)


def eventually(browser, holds):
    """Wait until a condition holds: a busy machine draws figures late."""
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 10).until(lambda _: holds())


def test_figures_zoom_together_over_the_frequency(browser, report):
    from selenium.webdriver.common.keys import Keys

    visit(browser, report)
    for figure in ("spectrum", "frequency_response"):
        bring(browser, figure)
    before = {name: picture(browser, name) for name in ("spectrum", "frequency_response")}
    assert len(before["frequency_response"]) == 3
    browser.find_element(
        "css selector", '#frequency_response button[aria-label="Zoom in: Frequency response"]'
    ).send_keys(Keys.ENTER)
    settle(browser)
    for name, pictures in before.items():
        for old, new in zip(pictures, picture(browser, name), strict=True):
            assert old != new, name
    browser.find_element(
        "css selector", '#spectrum button[aria-label="Whole range: Spectrum of the output"]'
    ).send_keys(Keys.ENTER)
    settle(browser)
    assert {name: picture(browser, name) for name in before} == before


def test_a_curve_is_hidden_and_shown_by_its_name(browser, report):
    from selenium.webdriver.common.keys import Keys

    visit(browser, report)
    bring(browser, "simulation")
    before = picture(browser, "simulation")
    name = browser.find_element("css selector", "#simulation .legend button")
    assert name.text == "measured"
    name.send_keys(Keys.ENTER)
    assert name.get_attribute("aria-pressed") == "false"
    settle(browser)
    assert picture(browser, "simulation")[0] != before[0]
    name.send_keys(Keys.SPACE)
    settle(browser)
    assert picture(browser, "simulation") == before


def test_the_cursor_reads_the_values_of_the_table(browser, report, results):
    from selenium.webdriver import ActionChains

    visit(browser, report)
    bring(browser, "simulation")
    over = browser.find_element("css selector", "#simulation .u-over")
    ActionChains(browser).move_to_element(over).perform()
    at, measured = browser.execute_script(
        """const panel = document.querySelector('#simulation .panel');
        return [panel.querySelector('.where').textContent,
                panel.querySelector('output').textContent];"""
    )
    time = float(at.removeprefix("at "))
    table = results.validation_tables.simulation
    output = f"output_{results.model.output_names[0]}"
    row = table.iloc[(table["time_s"] - time).abs().argmin()]
    assert row["time_s"] == pytest.approx(time, rel=1e-3)
    assert float(measured.replace("\u2212", "-")) == pytest.approx(row[output], rel=1e-3)


def test_a_click_tells_the_pole_that_it_is_next_to(browser, report, results):
    visit(browser, report)
    bring(browser, "stabilization")
    told = browser.execute_script(
        """const over = document.querySelector('#stabilization .u-over');
        const box = over.getBoundingClientRect();
        const status = document.querySelector('#stabilization .legend [role="status"]');
        const told = new Set();
        for (let x = 2; x < box.width; x += 8) {
            for (let y = 2; y < box.height; y += 8) {
                const at = {clientX: box.left + x, clientY: box.top + y, bubbles: true};
                for (const kind of ['mousemove', 'mousedown', 'mouseup', 'click']) {
                    over.dispatchEvent(new MouseEvent(kind, at));
                }
                told.add(status.textContent);
            }
        }
        return [...told];"""
    )
    poles = results.validation.modes.poles
    known = {f"order {pole.order}, frequency hz {pole.frequency_hz:.6g}" for pole in poles}
    assert {words.partition(", damping")[0] for words in told} == {"", *known}


def test_every_figure_can_be_zoomed(browser, report):
    visit(browser, report)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    figures = browser.execute_script(
        "return [...document.querySelectorAll('figure[data-name]')].map(f => f.closest('[id]').id)"
    )
    assert len(figures) == len(FIGURES)
    for figure in figures:
        bring(browser, figure)
    alive = "return [...document.querySelectorAll('figure.is-live canvas')].map(c => c.width)"
    assert min(browser.execute_script(alive)) > 100
    assert len(browser.find_elements("css selector", "figure.is-live")) == len(figures)
    assert browser.get_log("browser") == []


def test_a_logarithmic_axis_begins_anywhere(browser, report):
    visit(browser, report)
    browser.execute_script(
        """const figure = document.querySelector('#spectrum figure');
        const [panel] = JSON.parse(figure.dataset.panels);
        figure.dataset.panels = JSON.stringify([{...panel, limits: [0.0096, 166]}]);"""
    )
    bring(browser, "spectrum")
    assert browser.get_log("browser") == []


def test_a_click_in_the_complex_plane_tells_the_root(browser, report, results):
    visit(browser, report)
    bring(browser, "poles_zeros")
    pole = max(results.model.modes, key=lambda mode: mode.pole.imag).pole
    told = browser.execute_script(
        """const over = document.querySelector('#poles_zeros .u-over');
        const box = over.getBoundingClientRect();
        const place = (part, size) => size * (part / 2.6 + 0.5);  // from -1.3 to 1.3
        for (const kind of ['mousemove', 'mousedown', 'mouseup', 'click']) {
            over.dispatchEvent(new MouseEvent(kind, {bubbles: true,
                clientX: box.left + place(arguments[0], box.width),
                clientY: box.top + box.height - place(arguments[1], box.height)}));
        }
        return document.querySelector('#poles_zeros .legend [role="status"]').textContent;""",
        pole.real,
        pole.imag,
    )
    words = dict(pair.rsplit(" ", 1) for pair in told.split(", "))
    assert "pole" in words["kind"]
    assert abs(complex(float(words["real"]), float(words["imag"])) - pole) < 0.05


def test_frequencies_are_shown_in_hertz_or_radians_and_in_decades(browser, report):
    from selenium.webdriver.common.keys import Keys

    visit(browser, report)
    bring(browser, "frequency_response")

    def read(figure, share):
        """The abscissa at a share of the width."""
        bring(browser, figure)
        return browser.execute_script(
            """const panel = document.querySelector(`#${arguments[0]} .panel`);
            const over = panel.querySelector('.u-over');
            const box = over.getBoundingClientRect();
            over.dispatchEvent(new MouseEvent('mousemove', {bubbles: true,
                clientX: box.left + arguments[1] * box.width, clientY: box.top + 20}));
            return Number(panel.querySelector('.where').textContent.slice(3));""",
            figure,
            share,
        )

    def turn(words):
        label = f"{words}: frequencies, Frequency response"
        browser.find_element("css selector", f'[aria-label="{label}"]').send_keys(Keys.ENTER)
        settle(browser)

    def in_decades(figure):
        # Where decades are wide against the distance of the points that the cursor holds to.
        low, middle, high = (read(figure, share) for share in (0.6, 0.75, 0.9))
        return middle == pytest.approx(math.sqrt(low * high), rel=0.05)

    hertz = {figure: read(figure, 0.5) for figure in ("gain", "frequency_response")}
    turn("rad/s")
    for figure, value in hertz.items():
        turned = pytest.approx(2 * math.pi * value, rel=0.02)
        eventually(browser, lambda figure=figure, turned=turned: read(figure, 0.5) == turned)
    turn("log f")
    for figure in hertz:
        eventually(browser, lambda figure=figure: in_decades(figure))
    focused = browser.execute_script("return document.activeElement.textContent")
    assert focused == "log f"


def test_figures_follow_a_change_of_the_theme(browser, report):
    visit(browser, report, scheme="light")
    bring(browser, "gain")
    before = picture(browser, "gain")
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": "prefers-color-scheme", "value": "dark"}]},
    )
    bring(browser, "gain")
    after = picture(browser, "gain")
    assert len(after) == len(before) == 3  # gain, phase and coherence
    assert after != before


def titles(browser):
    """The panels of the first frequency response, by the beginning of their headings."""
    return browser.execute_script(
        """return [...document.querySelectorAll('#gain .panel-title')].map(
            each => each.textContent.split(' ')[0]);"""
    )


def test_phase_and_coherence_are_shown_below_the_gain_and_one_pair_at_a_time(browser, report):
    from selenium.webdriver.common.keys import Keys

    visit(browser, report, width=360)
    bring(browser, "gain")
    assert titles(browser) == ["Gain"]
    for part in ("phase", "coherence"):
        label = f"{part}: Frequency response over the data"
        browser.find_element("css selector", f'#gain [aria-label="{label}"]').send_keys(Keys.ENTER)
    assert titles(browser) == ["Gain", "Phase", "Coherence"]
    legends = browser.find_elements("css selector", "#gain .legend")
    assert ["band" in legend.text for legend in legends] == [True, False, False]
    assert browser.execute_script("return document.activeElement.textContent") == "coherence"
    visit(browser, report)
    bring(browser, "gain")
    browser.execute_script(
        """const figure = document.querySelector('#gain figure');
        const panels = JSON.parse(figure.dataset.panels);
        const named = (title, height) => panels.map(panel => ({...panel, title, height}));
        figure.dataset.panels = JSON.stringify([...named('one', 220), ...named('other', 240)]);"""
    )
    visible = "[aria-label='rad/s: frequencies, Frequency response over the data']"
    browser.find_element("css selector", visible).click()  # draws the figure again
    choice = browser.find_element("css selector", "#gain select")
    assert choice.text.split() == ["one", "other"]
    assert len(titles(browser)) == 3
    before = picture(browser, "gain")
    choice.send_keys("other")
    settle(browser)
    assert browser.execute_script("return document.activeElement.value") == "other"
    assert len(picture(browser, "gain")) == 3
    assert picture(browser, "gain") != before


def test_points_are_told_by_the_arrow_keys(browser, report, results):
    from selenium.webdriver.common.keys import Keys

    visit(browser, report)
    bring(browser, "stabilization")
    over = browser.find_element("css selector", "#stabilization .u-over")
    found = []
    for key in (Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_LEFT):
        over.send_keys(key)
        status = browser.find_element("css selector", '#stabilization .legend [role="status"]')
        found.append(status.text)
    lowest = min(results.validation.modes.poles, key=lambda pole: pole.frequency_hz)
    assert f"frequency hz {lowest.frequency_hz:.6g}" in found[0]
    assert found[2] == found[0] != found[1]


@pytest.mark.parametrize(("wish", "word"), [("reduce", "Move"), ("no-preference", "Stop")])
def test_shapes_move_unless_the_system_asks_for_less(browser, tmp_path, wish, word):
    page = tmp_path / "page.html"
    script = (TEMPLATES / "page.js").read_text(encoding="utf-8")
    page.write_text(
        f"""<p id="status"></p><details open><summary>Moving shapes</summary><svg><path d="M0 0">
        <animate attributeName="d" dur="2s" values="M0 0;M1 1"/></path></svg></details>
        <script>{script}</script>"""
    )
    visit(browser, page)
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": "prefers-reduced-motion", "value": wish}]},
    )
    browser.refresh()
    button = browser.find_element("css selector", "details button")
    stopped = "return document.querySelector('svg').animationsPaused()"
    assert button.text == word
    assert browser.execute_script(stopped) == (wish == "reduce")
    button.click()
    assert browser.execute_script(stopped) != (wish == "reduce")
