"""What the page says of the network."""

from __future__ import annotations

from qocjax.advice.advice import Advice, plain
from qocjax.commands.advice_page.words import ms
from qocjax.study.reliability import share_text

__all__ = ["network_lines"]


def network_lines(advice: Advice) -> list[str]:
    """Loop times, losses and bursts of the network at the deadlines that matter."""
    loop = advice.character
    percentiles = ", ".join(
        f"{name} {'none' if d is None else f'{d:.4g}'}" for name, d in plain(loop["percentiles_ms"]).items()
    )
    f_current = share_text(*advice.judged[["reliability", "reliability_se"]].iloc[0])
    f_best = share_text(loop["reliability"], loop["reliability_se"])
    run, alone = loop["mean_miss_run"], loop["independent_miss_run"]
    bursts = "no loop is missed" if run is None else (
        f"misses come {run:.2g} in a row on average ({alone:.2g} if independent), "
        f"99 % of these runs within {loop['p99_miss_run']}"
    )  # fmt: skip
    hangs = loop["delay_correlation"]
    return [
        f"  loop times that arrive (ms): {percentiles}; never: {loop['lost_share']:.2%} (lost, or dropped at a busy "
        "edge)",
        f"  F({ms(advice.recommended.deadline)} ms) = {f_best}, "
        f"F({ms(advice.current.deadline)} ms) = {f_current}; rank correlation of successive delays: "
        + ("not defined" if hangs is None else f"{hangs:.2f}"),
        f"  at {ms(advice.recommended.deadline)} ms {bursts}",
    ]
