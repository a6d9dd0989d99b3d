"""Where the replay plays: what to choose, a slider, a stage for each policy, and what the drawings mean."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from qocjax.report.html import escape, number, percent
from qocjax.report.labels import name_of, symbol, values_words
from qocjax.report.policies import mark
from qocjax.report.replay import Replay

__all__ = ["replay_html"]

_SPEEDS = (0.25, 0.5, 1.0, 2.0, 5.0)

_KEY = (
    ('<circle class="k-body" cx="9" cy="8" r="5"/><path d="M9 8h11"/>', "robot, heading; filled by a new command"),
    ('<circle class="k-hold" cx="9" cy="8" r="5"/><path d="M9 8h11"/>', "fades while the command is held"),
    ('<circle class="k-ghost" cx="11" cy="8" r="3.4"/>', "where it was when its command was computed from"),
    ('<circle class="k-disc" cx="11" cy="8" r="7"/>', "safety disc: two overlap when nearer than the safety distance"),
    ('<path class="k-trail" d="M1 12C8 12 8 4 21 4"/>', "the last 3 s"),
    ('<path class="k-ref" d="M1 8h20"/><path class="k-now" d="M11 4l4 4-4 4-4-4z"/>', "reference, and where it is now"),
    ('<path class="k-goal" d="M11 1l2 5 5 .3-4 3.3 1.4 5.2-4.4-2.9-4.4 2.9L8 9.6 4 6.3 9 6z"/>', "goal; grid of 1 m"),
)


def replay_html(replays: Sequence[Replay], text: str, choice: str = "Sweep") -> str:
    """The frame that the script fills.

    Args:
        replays: As given to `replay_data`.
        text: Which run of each is shown; plain.
        choice: What groups of runs are called; plain.
    """
    groups = {each.chosen_by: each for each in replays}
    choices = "".join(f'<option value="{escape(name)}">{_group(each)}</option>' for name, each in groups.items())
    speeds = "".join(
        f'<option value="{speed}"{" selected" if speed == 1 else ""}>{speed:g}×</option>' for speed in _SPEEDS
    )
    stages = "".join(_stage(k, each, each.chosen_by == replays[0].chosen_by) for k, each in enumerate(replays))
    return f"""<p>{escape(text)}</p>
<div class="controls">
<button type="button" id="play">▶ Play</button>
<input type="range" id="time" min="0" max="1" step="0.05" value="0" aria-label="Time">
<output id="clock" for="time">0.00 s</output>
<label>{escape(choice)} <select id="replayed">{choices}</select></label>
<label>Speed <select id="speed">{speeds}</select></label>
</div>
<div class="stages">{stages}</div>
<p class="key">{"".join(_meaning(*item) for item in _KEY)}</p>"""


def _stage(index: int, each: Replay, shown: bool) -> str:
    run = each.run
    near, choice = float(run.min_distance), values_words(each.values)
    distance = f", nearest {number(near, '.3f')} m" if np.isfinite(near) else ""
    warn = ' <strong class="warn">(closer than two radii)</strong>' if bool(run.collided) else ""
    return (
        f'<article class="stage" data-run="{index}" data-sweep="{escape(each.chosen_by)}"{"" if shown else " hidden"} '
        f'aria-label="{escape(each.policy)}"><h3>{mark(each.policy)} {escape(each.policy)}</h3>'
        f"<p>{choice}, Δ = "
        f"{number(1e3 * each.deadline)} ms, <i>F</i>(Δ) = {percent(each.reliability)}; AUC "
        f"{number(float(np.mean(run.auc)), '.3f')} s{distance}{warn}</p>"
        '<div class="hall"></div><div class="ages"></div><div class="status"></div></article>'
    )


def _meaning(drawing: str, text: str) -> str:
    return f'<span><svg viewBox="0 0 22 16" aria-hidden="true">{drawing}</svg>{text}</span>'


def _group(each: Replay) -> str:
    return escape(each.group) if each.group else f"{name_of(each.sweep)} {_flat(symbol(each.sweep))}"


def _flat(text: str) -> str:
    """A symbol without tags, for the list of choices."""
    return re.sub(r"</?\w+>", "", text)
