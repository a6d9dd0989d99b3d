"""The page of an advice: what a terminal shows."""

from __future__ import annotations

from qocjax.advice.advice import Advice
from qocjax.commands.advice_page.decision import decision_lines, present_lines
from qocjax.commands.advice_page.margins import cliff_lines, margin_lines, sensitivity_lines, slack_lines
from qocjax.commands.advice_page.network import network_lines
from qocjax.commands.advice_page.tables import judged_table, stress_lines, tie_line
from qocjax.quality import qoc
from qocjax.statistics.scales import scale_text

__all__ = ["page"]


def page(advice: Advice) -> str:
    """The advice as one page for a terminal: the decision first, then what it rests on."""
    lines = [
        *decision_lines(advice),
        "",
        *present_lines(advice),
        "",
        "JUDGED ON FRESH SEEDS",
        judged_table(advice),
        tie_line(advice.ties),
        "",
        f"NETWORK  {advice.network.get('name', '')}",
        *network_lines(advice),
        "",
        "IF THE NETWORK BECOMES WORSE",
        *stress_lines(advice),
        *cliff_lines(advice),
        "",
        *margin_lines(advice),
        *slack_lines(advice),
        *sensitivity_lines(advice),
        "",
        scale_text(advice.scale, "of your gains over the deadlines tried, or given", True),
        f"1 would be perfect, {float(qoc(advice.scale.largest, advice.scale)):.3f} is the worst.",
        f"Searched on {advice.seeds['search']} seeds, chosen on {advice.seeds['choice']} others, judged on "
        f"{advice.seeds['fresh']} fresh ones; {advice.simulations} simulations.",
    ]
    return "\n".join(lines)
