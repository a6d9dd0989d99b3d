"""The page of a study, as a reader meets it in a browser, and what cannot get out of its data into it."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from matplotlib.image import imread

from qocjax import Design, Rules, Scenario, Study, one_at_a_time, paper_network, replay, simulate
from qocjax.batch.drawing import draw_seeds
from qocjax.cost_values import LETHAL
from qocjax.navigation import Grid
from qocjax.navigation.maps import Rectangle, map_of_shapes
from qocjax.report import StudyPage, hall_map, study_page, write_study_report
from qocjax.report.delays import delay_chart, late_chart
from qocjax.report.html import escape, interval, json_text, number, plus_minus
from qocjax.report.replay import hold_times, replay_data
from qocjax.report.sweeps import auc_legend, qoc_chart
from qocjax.study.problem import Problem
from qocjax.study.replays import PolicyRun, policy_runs, replays
from qocjax.study.replays import _draw as draw_all
from qocjax.study.sweep import study_of

SCENARIO = Scenario(horizon=8.0)
GRID = one_at_a_time(
    Design(tau=0.05), {"v_max": [0.4, 0.7], "eta": [0.0, 0.6], "kappa": [1.0, 2.0, 4.0]}, [0.0, 0.1, 0.2, 0.3, 0.8]
)
PROBLEM = Problem(SCENARIO, GRID.designs, paper_network(), Rules(), 3)
HOSTILE = (
    "</script><script>document.title = 'owned'</script><img src=x onerror=\"document.title='owned'\">&amp;'\"\u2028"
)


@pytest.fixture(scope="module")
def study() -> Study:
    found = study_of(PROBLEM, GRID, range(4), range(10, 16))
    return replace(found, configuration={"key": 3, "note": HOSTILE})


@pytest.fixture(scope="module")
def runs(study: Study) -> list[PolicyRun]:
    return policy_runs(study, PROBLEM)


@pytest.fixture(scope="module")
def content(study: Study, runs: list[PolicyRun]) -> StudyPage:
    room = map_of_shapes(Grid.covering((-3.0, -2.0), (3.0, 2.0), 0.05), [Rectangle((0.0, 1.5), (1.0, 0.2))])
    return study_page("a small study", study, PROBLEM, runs, room)


# Runs of the policies again


def test_runs_in_one_program_are_those_of_replay() -> None:
    """Also where the sampling period is another than that of the longest run."""
    designs = [Design(tau=0.05, deadline=0.12), Design(tau=0.2, deadline=0.3, eta=0.1)]
    for design, run in zip(designs, replays(SCENARIO, designs, paper_network(), 7, key=3), strict=True):
        alone = jax.tree.map(np.asarray, replay(SCENARIO, design, paper_network(), 7, key=3))
        for name in ("time", "pose", "command", "age", "auc", "reference", "min_distance", "arrival_time",
                     "completed_share", "age_mean", "age_peak"):  # fmt: skip
            found = getattr(run, name)
            assert found.shape == getattr(alone, name).shape
            np.testing.assert_allclose(found, getattr(alone, name), rtol=1e-7, atol=1e-9, err_msg=name)


def test_policies_share_the_seed_and_the_safe_sweeps_come_first(study: Study, runs: list[PolicyRun]) -> None:
    assert [each.policy for each in runs] == ["Co-design", "MinDelay", "MaxRel"] * 3
    assert len({each.seed for each in runs}) == 1
    shares = study.policies.query("policy == 'Co-design'").set_index("sweep")["collision_share"]
    order = list(dict.fromkeys(each.sweep for each in runs))
    assert [bool(shares[sweep] > 0) for sweep in order] == sorted(bool(share > 0) for share in shares)
    starts = {each.run.pose[0].tobytes() for each in runs}
    assert len(starts) == 1


def test_loops_that_vary_with_the_period_are_drawn_for_each() -> None:
    class Plain:
        """A network of which nothing is known beforehand."""

        name = "plain"

        def draw(self, key: jax.Array, num_ticks: int, num_robots: int, tau: float) -> jax.Array:
            return jax.random.uniform(key, (num_ticks, num_robots)) * tau

    start, times, _ = draw_all(SCENARIO, Plain(), 5, 0, [Design(tau=0.05), Design(tau=0.2)], [160, 40])
    for row, (tau, count) in enumerate(((0.05, 160), (0.2, 40))):
        one = draw_seeds(
            jax.numpy.asarray(SCENARIO.start), SCENARIO.start_jitter, Plain(), np.array([5]), 0, count, tau
        )
        np.testing.assert_array_equal(start, one.start[0])
        np.testing.assert_array_equal(times[row, :count], one.network[0])
        assert np.isinf(times[row, count:]).all() and len(times[row]) == 160


def test_hold_times_follow_from_the_loops_that_complete() -> None:
    """Loops 0, 3, 4 of 8 complete with a deadline of two periods; before the first command the robot waits."""
    times = np.full((8, 1), np.inf)
    times[[0, 3, 4]] = 0.0
    scenario = Scenario(start=[[-1.0, 0.0, 0.0]], goal=[1.0, 0.0], horizon=0.8, normaliser="goal_distance")
    run = jax.tree.map(np.asarray, simulate(scenario, Design(tau=0.1, deadline=0.2), times))
    held, waiting = hold_times(run, 0.1)
    np.testing.assert_allclose(held[:, 0], [0, 0, 0, 0.1, 0.2, 0, 0, 0.1], atol=1e-9)
    assert waiting[:, 0].tolist() == [True, True, *[False] * 6]


def test_replay_data_are_the_run_in_whole_numbers(content: StudyPage) -> None:
    data = replay_data(content.replays, content.hall)
    for each, raw in zip(content.replays, data["runs"], strict=True):
        x = np.cumsum(raw["x"], axis=1) / 1e3
        step = round(raw["dt"] / each.tau)
        at = np.unique(np.append(np.arange(0, each.run.age.shape[0], step), each.run.age.shape[0]))
        np.testing.assert_allclose(x.T, each.run.pose[at, :, 0], atol=5.1e-4)
    left, right, bottom, top = data["runs"][0]["box"]
    assert left < -2 and right > 2 and bottom < -1.5 and top > 1.5
    assert data["map"]["extent"] == pytest.approx([-3, 3, -2, 2])


def test_many_robots_are_sampled_less_often(content: StudyPage) -> None:
    many = [content.replays[0]] * 60
    run = many[0].run
    wide = replace(run, pose=np.repeat(run.pose, 40, axis=1), age=np.repeat(run.age, 40, axis=1),
                   command=np.repeat(run.command, 40, axis=1))  # fmt: skip
    data = replay_data([replace(each, run=wide) for each in many])
    assert len(json_text(data)) < 3e6
    assert data["runs"][0]["dt"] > 0.05


def test_map_is_a_picture_that_begins_at_the_top(content: StudyPage) -> None:
    room = map_of_shapes(Grid.covering((0.0, 0.0), (1.0, 0.5), 0.1), [Rectangle((0.05, 0.05), (0.1, 0.1))])
    assert (room.cost == LETHAL).sum() == 1
    picture = imread(io.BytesIO(hall_map(room).png))
    assert picture.shape == (5, 10, 4)
    assert picture[-1, 0, 3] > 0.8 and np.delete(picture[..., 3].ravel(), 40).max() == 0
    large = map_of_shapes(Grid.covering((0.0, 0.0), (100.0, 10.0), 0.05), [Rectangle((99.9, 9.9), (0.1, 0.1))])
    shown = hall_map(large)
    assert imread(io.BytesIO(shown.png)).shape[:2] == (67, 667)
    assert shown.extent == pytest.approx((0, 100.05, 0, 10.05))


# Text on its way into the page


@pytest.mark.parametrize(
    "text", [HOSTILE, "<!--", "]]>", "\x00\x1b[31m", "a\u2028b", "caf\udce9", "${x}", "{script}", "%s"]
)
def test_text_cannot_leave_its_place(text: str) -> None:
    assert not re.search(r"[<>\"']", escape(text))
    packed = json_text({"a": [text]})
    assert not re.search(r"[<>&\u2028\u2029]", packed)
    assert json.loads(packed)["a"][0].encode("utf-8") == text.encode("utf-8", "backslashreplace")
    assert escape(text).encode("utf-8")


def test_json_knows_no_nan() -> None:
    packed = json.loads(json_text({"a": np.array([1.0, np.nan, np.inf]), "b": np.float32(2), 3: (np.int64(4), True)}))
    assert packed == {"a": [1.0, None, None], "b": 2.0, "3": [4, True]}


def test_numbers_as_text() -> None:
    assert number(-0.25, "+.2f") == "−0.25"
    assert number(np.nan) == "–" and plus_minus(1.0, np.inf, ".1f") == "1.0"
    assert interval(-1.0, 2.0, ".1f") == "[−1.0, 2.0]"


@pytest.fixture(scope="module")
def hostile_page(content: StudyPage, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page whose every text tries to be a script."""
    page = replace(
        content, name=HOSTILE, network=HOSTILE, about={HOSTILE: HOSTILE}, config=HOSTILE, record=HOSTILE,
        failures={HOSTILE: HOSTILE},
    )  # fmt: skip
    return write_study_report(tmp_path_factory.mktemp("hostile") / "report.html", page)


def test_page_is_one_small_file_that_names_nothing_outside(content: StudyPage, tmp_path: Path) -> None:
    path = write_study_report(tmp_path / "report.html", content)
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 5e6
    own = re.sub(r'<script type="text/plain" id="plotly">.*?</script>', "", text, flags=re.DOTALL)
    loads = re.findall(r"""(?:src|href)=["']([^"'#][^"']*)""", own)
    assert [each for each in loads if not each.startswith("data:")] == []
    assert set(re.findall(r"https?://[^\s\"']+", own)) <= {"http://www.w3.org/2000/svg"}
    assert "default-src 'none'" in text and "unsafe-eval" not in text


def test_what_collides_too_often_is_crossed_and_tails_are_seen(content: StudyPage) -> None:
    rows = content.results.assign(collision_share=np.where(content.results["deadline"] > 0.2, 1.0, 0.0), seeds=100)
    sweep = rows["sweep"].iloc[0]
    plain, crossed = (qoc_chart(rows, content.policies, sweep, limit)["data"] for limit in (None, 0.05))
    (crosses,) = [each for each in crossed if each.get("marker", {}).get("symbol") == "x-thin"]
    assert len(crossed) == len(plain) + 1 and min(crosses["x"]) > 200
    assert len(crosses["x"]) == ((rows["sweep"] == sweep) & (rows["deadline"] > 0.2)).sum()
    whole = delay_chart(content.completion, content.policies)["data"]
    for late, trace in zip(late_chart(content.completion, content.policies)["data"], whole, strict=True):
        told = np.array([np.nan if each is None else each for each in late["y"]], float)
        known = np.isfinite(told)
        np.testing.assert_allclose(told[known], 1.0 - np.asarray(trace["y"])[known], atol=1e-12)
        assert (np.asarray(trace["y"])[~known] > 1.0 - 1e-5).all()


def test_the_baseline_of_a_single_sweep_is_emphasised(content: StudyPage) -> None:
    """No other sweep holds it."""
    alone = content.results[content.results["sweep"] == "kappa"]
    value = float(alone["value"].iloc[0])
    assert "(baseline)" not in auc_legend(alone, "kappa")
    assert f">{value:g} (baseline)<" in auc_legend(alone, "kappa", {"kappa": value})
    ticks = qoc_chart(alone, content.policies, "kappa", None, {"kappa": value})["layout"]["yaxis"]["ticktext"]
    assert [text for text in ticks if "<b>" in text] == [f"<b>{value:g}</b>"]


def test_what_failed_or_diverged_is_told(content: StudyPage, tmp_path: Path) -> None:
    results, policies = content.results.copy(), content.policies.copy()
    numbers = ["qoc", "qoc_se", "auc", "auc_se", "min_distance", "min_distance_se"]
    results.loc[[0, 7], numbers] = np.nan
    results.loc[7, "diverged_share"] = 0.5
    policies.loc[policies["sweep"] == "eta", ["value", "deadline", "qoc", "qoc_low", "qoc_high", "auc"]] = np.nan
    policies["error"] = np.where(policies["qoc"].isna(), "every design diverged or failed", "")
    page = replace(content, results=results, policies=policies, failures={"selection-0": "out of memory"}, replays=())
    text = write_study_report(tmp_path / "report.html", page).read_text(encoding="utf-8")
    assert "1 chunks failed: out of memory" in text and "1 of 35 designs diverged" in text
    assert text.count("every design diverged or failed") == 3
    policies["qoc"] = np.nan
    write_study_report(tmp_path / "report.html", replace(page, policies=policies))
    assert "No sweep found a design" in (tmp_path / "report.html").read_text(encoding="utf-8")


# In a browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="no playwright here (pip install playwright)")
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no chromium here (Debian: apt install chromium)")
    options = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    with api.sync_playwright() as playwright:
        try:
            running = playwright.chromium.launch(executable_path=program, args=options)
        except api.Error as error:
            pytest.skip(f"{program} does not start: {str(error).splitlines()[0]}")
        yield running
        running.close()


class Visit:
    """A page in a window, with what it said and asked for."""

    def __init__(self, browser: Any, path: Path, width: int = 1280, scheme: str = "light") -> None:
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.page = context.new_page()
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-charts=done]")

    def value(self, expression: str) -> Any:
        return self.page.evaluate(expression)

    def robot(self, stage: int = 0) -> tuple[float, float]:
        body = self.page.locator(".stage:not([hidden])").nth(stage).locator("circle.body").first
        return float(body.get_attribute("cx")), float(body.get_attribute("cy"))


@pytest.fixture(scope="module")
def report(content: StudyPage, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_study_report(tmp_path_factory.mktemp("report") / "report.html", content)


@pytest.fixture(scope="module")
def visit(browser: Any, report: Path) -> Visit:
    return Visit(browser, report)


def test_nothing_is_said_and_nothing_asked_for(visit: Visit, report: Path) -> None:
    assert visit.said == []
    assert visit.asked == [report.as_uri()]
    assert visit.value("document.querySelectorAll('.chart.drawn .main-svg').length") >= 7
    assert visit.value("performance.getEntriesByType('paint')[0].startTime") < 2000


def test_table_has_the_numbers_of_the_study(visit: Visit, study: Study) -> None:
    cells = visit.page.locator("table.policies tbody tr").all_inner_texts()
    assert len(cells) == len(study.policies)
    for text, row in zip(cells, study.policies.to_dict("records"), strict=True):
        assert plus_minus(row["qoc"], row["qoc_se"]) in text
        assert row["policy"] in text


@pytest.mark.parametrize("width", [1200, 800, 390])
def test_nothing_is_cut_off_or_covered(browser: Any, report: Path, width: int) -> None:
    """The table has all its columns in view; the toolbar of a chart lies above it, and sends nothing anywhere."""
    seen = Visit(browser, report, width)
    assert (
        seen.value("(() => { const t = document.querySelector('.scroll'); return t.scrollWidth - t.clientWidth })()")
        <= 0
    )
    gaps = seen.value(
        "[...document.querySelectorAll('.chart.drawn')].map(c => c.getBoundingClientRect().y"
        " - c.querySelector('.modebar').getBoundingClientRect().bottom)"
    )
    assert gaps and (width < 700 or min(gaps) >= -1)
    assert width < 700 or seen.value("document.querySelector('.modebar').offsetWidth") > 0
    assert seen.page.locator("[aria-label^='Share']").count() == 0


def hover(visit: Visit, sweep: str, value: float, deadline: float) -> str:
    """What the map says when the pointer is on a cell."""
    visit.page.click(f"#tab-{sweep}")
    chart = visit.page.locator(f"#chart-qoc-{sweep}")
    values = sorted(set(GRID.value[GRID.sweep == sweep]))
    chart.scroll_into_view_if_needed()
    x, y = visit.value(
        f"(() => {{ const c = document.getElementById('chart-qoc-{sweep}'), f = c._fullLayout, b ="
        f" c.getBoundingClientRect(); return [b.x + f.xaxis._offset + f.xaxis.d2p({1e3 * deadline}),"
        f" b.y + f.yaxis._offset + f.yaxis.d2p({values.index(value)})]; }})()"
    )
    visit.page.mouse.move(x - 3, y)
    visit.page.mouse.move(x, y)
    visit.page.wait_for_selector(f"#chart-qoc-{sweep} .hoverlayer .hovertext")
    return chart.locator(".hoverlayer").text_content()


@pytest.mark.parametrize(("sweep", "value", "deadline"), [("kappa", 2.0, 0.2), ("v_max", 0.4, 0.8), ("eta", 0.0, 0.1)])
def test_hover_says_what_the_table_says(visit: Visit, study: Study, sweep: str, value: float, deadline: float) -> None:
    text = hover(visit, sweep, value, deadline)
    row = study.results.query("sweep == @sweep and value == @value and deadline == @deadline").iloc[0]
    for wanted in (
        f"Δ = {1e3 * deadline:.0f} ms", number(row["reliability"], ".3f"), plus_minus(row["qoc"], row["qoc_se"]),
        f"{plus_minus(row['auc'], row['auc_se'], '.3f')} s",
        f"{plus_minus(row['min_distance'], row['min_distance_se'], '.3f')} m",
    ):  # fmt: skip
        assert wanted in text
    chosen = study.policies.query("sweep == @sweep and value == @value and deadline == @deadline")
    for each in chosen.to_dict("records"):
        assert f"{each['policy']}: QoC {plus_minus(each['qoc'], each['qoc_se'])} on fresh seeds" in text


def test_arrow_keys_read_out_the_same(visit: Visit, study: Study) -> None:
    visit.page.click("#tab-kappa")
    visit.page.focus("#chart-qoc-kappa")
    for key in ("ArrowRight", "ArrowRight", "ArrowUp"):
        visit.page.keyboard.press(key)
    row = study.results.query("sweep == 'kappa' and value == 2.0 and deadline == 0.2").iloc[0]
    text = visit.page.locator("#panel-kappa .readout").inner_text()
    assert plus_minus(row["qoc"], row["qoc_se"]) in text and "Δ = 200 ms" in text


def test_tabs_work_with_the_keyboard(visit: Visit) -> None:
    visit.page.click("#tab-v_max")
    visit.page.keyboard.press("ArrowRight")
    assert visit.value("document.activeElement.id") == "tab-eta"
    assert visit.page.locator("#panel-eta").is_visible() and not visit.page.locator("#panel-v_max").is_visible()
    visit.page.keyboard.press("End")
    assert visit.page.locator("#tab-kappa").get_attribute("aria-selected") == "true"
    outline = visit.value("getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"


def test_slider_moves_the_robots(visit: Visit, content: StudyPage) -> None:
    """To where they are in the run; also by the keyboard."""
    slider = visit.page.locator("#time")
    for time in (0.0, 4.0, 8.0):
        slider.evaluate(f"e => {{ e.value = {time}; e.dispatchEvent(new Event('input')); }}")
        for stage in range(3):
            run = content.replays[stage].run
            at = int(np.argmin(np.abs(run.time - time)))
            x, y = visit.robot(stage)
            assert (x, -y) == pytest.approx(tuple(100 * run.pose[at, 0, :2]), abs=0.2)
        assert f"{time:.2f} s" in visit.page.locator("#clock").inner_text()
    before = visit.robot()
    slider.focus()
    for _ in range(20):
        visit.page.keyboard.press("ArrowLeft")
    assert visit.robot() != before and visit.page.locator("#clock").inner_text().startswith("7.00 s")
    assert "held for" in visit.page.locator(".stages").inner_text()


def test_play_and_pause(visit: Visit) -> None:
    button = visit.page.locator("#play")
    visit.page.locator("#time").evaluate("e => { e.value = 0; e.dispatchEvent(new Event('input')); }")
    button.focus()
    visit.page.keyboard.press("Enter")
    assert "Pause" in button.inner_text()
    visit.page.wait_for_timeout(400)
    visit.page.keyboard.press("Space")
    assert "Play" in button.inner_text()
    moved = float(visit.page.locator("#time").input_value())
    assert 0.1 < moved < 5.0
    visit.page.wait_for_timeout(150)
    assert float(visit.page.locator("#time").input_value()) == moved


def test_another_sweep_is_replayed(visit: Visit, content: StudyPage) -> None:
    sweeps = list(dict.fromkeys(each.sweep for each in content.replays))
    visit.page.select_option("#replayed", sweeps[1])
    shown = visit.page.locator(".stage:not([hidden])")
    assert shown.count() == 3
    assert [shown.nth(k).get_attribute("data-sweep") for k in range(3)] == [sweeps[1]] * 3
    assert shown.first.locator("image.map").count() == 1
    visit.page.select_option("#replayed", sweeps[0])


def brightness(visit: Visit, selector: str, name: str) -> float:
    colour = visit.value(f"getComputedStyle(document.querySelector('{selector}')).{name}")
    return float(np.mean([float(part) for part in re.findall(r"[\d.]+", colour)[:3]]))


def test_dark_and_light_follow_the_system_and_the_button(browser: Any, report: Path) -> None:
    visit = Visit(browser, report, scheme="dark")
    text = "#chart-delay .xtick text"
    assert brightness(visit, "body", "backgroundColor") < 60 < 180 < brightness(visit, "body", "color")
    assert brightness(visit, text, "fill") > 180
    visit.page.click("#theme")  # dark
    visit.page.click("#theme")  # light
    assert "light" in visit.page.locator("#theme").inner_text()
    assert brightness(visit, "body", "backgroundColor") > 220
    assert brightness(visit, text, "fill") < 80
    visit.page.emulate_media(media="print")
    assert brightness(visit, "body", "backgroundColor") > 220
    assert visit.said == []


def test_phone_needs_no_sideways_scrolling(browser: Any, report: Path) -> None:
    visit = Visit(browser, report, width=390)
    assert visit.value("document.documentElement.scrollWidth") <= 390
    boxes = visit.value(
        "[...document.querySelectorAll('.stage, .chart, #time')].map(e => e.getBoundingClientRect().right)"
    )
    assert max(boxes) <= 390
    assert visit.said == []


def test_print_shows_every_sweep(browser: Any, report: Path) -> None:
    visit = Visit(browser, report)
    visit.page.emulate_media(media="print", color_scheme="light")
    for sweep in ("v_max", "eta", "kappa"):
        assert visit.page.locator(f"#panel-{sweep}").is_visible()
        assert visit.page.locator(f"#chart-qoc-{sweep} .main-svg").first.is_visible()
    assert not visit.page.locator("#play").is_visible()
    assert visit.page.pdf(prefer_css_page_size=True).startswith(b"%PDF")


def test_hostile_text_stays_text(browser: Any, hostile_page: Path) -> None:
    visit = Visit(browser, hostile_page)
    assert visit.said == [] and len(visit.asked) == 1
    assert visit.page.title() == HOSTILE.replace("\u2028", " ").strip() or "owned" != visit.page.title()
    assert visit.page.locator("h1").inner_text().startswith("</script>")
    assert visit.page.locator("img").count() == 0
    assert visit.value("document.querySelectorAll('script').length") == 4  # data, library twice, script


def test_injected_script_would_not_run(browser: Any, report: Path, tmp_path: Path) -> None:
    """Even if a text got through: the page's policy allows its own script and Plotly's only."""
    text = report.read_text(encoding="utf-8")
    path = tmp_path / "broken.html"
    path.write_text(text.replace("<main", "<script>document.title = 'owned'</script><main", 1), encoding="utf-8")
    visit = Visit(browser, path)
    assert visit.page.title() != "owned"
    assert any("Content Security Policy" in line for line in visit.said)
