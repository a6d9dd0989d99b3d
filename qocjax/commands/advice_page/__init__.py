"""The page of an advice: what a terminal shows."""

from __future__ import annotations

from qocjax.advice.advice import Advice
from qocjax.commands.advice_page.decision import decision_lines, present_lines
from qocjax.commands.advice_page.margins import cliff_lines, margin_lines, sensitivity_lines, slack_lines
from qocjax.commands.advice_page.network import network_lines
from qocjax.commands.advice_page.tables import judged_table, stress_lines, tie_line
from qocjax.commands.assumed import Given
from qocjax.quality import qoc
from qocjax.statistics.scales import scale_text

__all__ = ["page"]


def page(advice: Advice, given: Given | None = None) -> str:
    """The advice as one page for a terminal: the decision first, then what it rests on.

    Args:
        advice: What is advised.
        given: What a user gave of what it is compared with; by default all of it.
    """
    given = given or Given()
    lines = [
        *decision_lines(advice, given),
        "",
        *present_lines(advice, given),
        "",
        "JUDGED ON FRESH SEEDS",
        judged_table(advice, given),
        tie_line(advice.ties),
        "",
        f"NETWORK  {advice.network.get('name', '')}",
        *network_lines(advice),
        "",
        "IF THE NETWORK BECOMES WORSE",
        *stress_lines(advice, given),
        *cliff_lines(advice),
        "",
        *margin_lines(advice),
        *slack_lines(advice),
        *sensitivity_lines(advice),
        "",
        scale_text(advice.scale, f"of {given.of_gains} over the deadlines tried, or given", True),
        f"1 would be perfect, {float(qoc(advice.scale.largest, advice.scale)):.3f} is the worst.",
        f"Searched on {advice.seeds['search']} seeds, chosen on {advice.seeds['choice']} others, judged on "
        f"{advice.seeds['fresh']} fresh ones; {advice.simulations} simulations.",
    ]
    return "\n".join(lines)
