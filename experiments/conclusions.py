"""What the paper observes, sentence by sentence in its words, and how each is put to the test, whatever is simulated.

Numbers are the paper's: sections III and IV (curves of AUC), V (policies), and its observations (i) to (vi) on single
parameters. A sentence that says several things has a letter for each. What no simulation here can say has its reason in
place of a test. `MODEL` has readings that the paper does not spell out, and what it does not ask.
"""

from __future__ import annotations

from dataclasses import dataclass

from experiments.claims import Test, curves, parameters, policies
from experiments.settings import Bench
from experiments.verdicts import Finding


@dataclass(frozen=True)
class Conclusion:
    """A sentence of the paper, or a reading of one."""

    number: str
    quote: str  # the paper's words; empty for what it does not say
    claim: str  # what is tested, in short
    test: Test | str  # a text says why there is none
    sweep: str = "any"  # in which a reader of a study meets it

    def judge(self, bench: Bench) -> Finding:
        """Puts it to the test.

        Raises:
            TypeError: It cannot be tested.
        """
        if isinstance(self.test, str):
            raise TypeError(f"{self.number}: {self.test}")
        return self.test(bench)


_WORDS = "a definition, from which nothing follows that could fail"
_MEASURED = "needs the AUC that the paper measured, which is not published; `qocjax.validate` takes other measurements"
_ROBOTS = "measured on robots over a link whose losses are not published; `qocjax.qos` says what a model of it gives"

SENTENCES = (
    Conclusion("III.1", "at very low latency-reliability levels, AUC … worsens substantially, across the entire range "
               "of simulated values for both the repulsive gain and the sampling period",
               "AUC is worst at very low Δ, for all η and τ", curves.worse_early),
    Conclusion("III.2", "attributed to very high packet drops that did not let the control commands be updated",
               "Missed loops make it so", curves.drops),
    Conclusion("III.3",
               "Once sufficient reliability is achieved, AUC remains largely unchanged with different sampling periods",
               "Past enough reliability AUC hardly depends on τ", curves.sampling, "tau"),
    Conclusion("III.4", "worsening AUC as the repulsive gain grows together with high delays",
               "AUC worsens with η, more so at high delay", curves.repulsion, "eta"),
    Conclusion("IV.1", "Both cases follow similar trends", "simulation and experiment agree", _MEASURED),
    Conclusion("IV.2a", "reliability improving strongly around 100–200 ms", "F rises strongly between 100 and 200 ms",
               curves.reliability),
    Conclusion("IV.2b", "", "AUC falls steeply between 100 and 200 ms (a reading)", curves.steep_fall),
    Conclusion("IV.3", "the delay dominance region starts at similar delays as well", "the same of the last regime",
               _MEASURED),
    Conclusion("IV.4", "the low-reliability, intermediate-reliability, and delay-dominant regimes are reproduced",
               "AUC has three regimes, an intermediate Δ is best", curves.regimes),
    Conclusion("V.1", "MinDelay can be suboptimal because low delay does not guarantee timely/reliable loop "
               "completion, leading to stale/missed updates (ZOH) and increased disagreement",
               "Co-design beats MinDelay, which misses loops", policies.min_delay),
    Conclusion("V.2",
               "MaxRel improves delivery probability but incurs large delays, making the closed-loop response sluggish",
               "Co-design beats MaxRel, which is sluggish", policies.max_rel),
    Conclusion("V.3", "selects intermediate delay-reliability regimes and corresponding parameter values that maximize "
               "QoC, consistently", "Co-design is best, at an intermediate Δ", policies.co_design),
    Conclusion("i.1", "governs how aggressively robots can react to goal and avoidance commands", "what ν^max is",
               _WORDS),
    Conclusion("i.2", "under MinDelay (low reliability), higher ν^max amplifies the effect of stale headings and can "
               "increase disagreement", "A higher ν^max hurts under MinDelay", parameters.mobility_hurts, "v_max"),
    Conclusion("i.3",
               "co-design prefers moderate delays where updates are reliable enough to safely exploit higher mobility",
               "Co-design gains safely by a higher ν^max", parameters.mobility_pays, "v_max"),
    Conclusion("ii.1", "larger repulsion spreads robots apart", "η keeps robots apart", parameters.spreads, "eta"),
    Conclusion("ii.2", "can increase disagreement", "A larger η can raise AUC", parameters.disagreement, "eta"),
    Conclusion("ii.3", "the QoC-optimal setting tends to be moderate (or lower)", "A lower to moderate η wins",
               parameters.low_repulsion, "eta"),
    Conclusion("ii.4", "while still preventing close approaches", "The η that wins keeps robots apart",
               parameters.keeps_apart, "eta"),
    Conclusion("iii.1", "changes both the control update rate and the per-attempt transmission granularity",
               "what τ is", "a definition, and on the paper's network nothing is transmitted (T_UL = T_DL = 0)"),
    Conclusion("iii.2", "when reliability is low, frequent updates do not help because many are missed (ZOH dominates)",
               "Frequent updates do not help at low reliability", parameters.frequent_updates, "tau"),
    Conclusion("iii.3", "at reliable operating points an appropriate τ reduces staleness without inducing overly "
               "sluggish behavior", "At reliable Δ a shorter τ makes commands fresher", parameters.fresher, "tau"),
    Conclusion("iv.1a", "too large κ under stale information can cause overshoot/oscillation",
               "A large κ on stale information makes robots oscillate", parameters.oscillation, "kappa"),
    Conclusion("iv.1b", "can cause … (worse QoC)", "A large κ on stale information can cost QoC",
               parameters.stiff(True), "kappa"),
    Conclusion("iv.1c", "", "A large κ on stale information always costs QoC", parameters.stiff(False),
               "kappa"),
    Conclusion("iv.2", "too small κ yields slow convergence", "Robots with a small κ come late", parameters.slow,
               "kappa"),
    Conclusion("iv.3a", "co-design selects κ jointly with an intermediate delay where the loop is both responsive",
               "Co-design's Δ for κ is intermediate and responsive", parameters.between("kappa"), "kappa"),
    Conclusion("iv.3b", "and reliable", "Co-design's Δ for κ is reliable (F > 1/2)", parameters.reliable("kappa"),
               "kappa"),
    Conclusion("v.1", "aggressive heading gains are sensitive to delayed direction estimates",
               "A high γ hurts at high delay", parameters.late_heading, "gamma"),
    Conclusion("v.2a", "operating in regimes where heading errors are updated reliably",
               "Co-design's Δ for γ is reliable (F > 1/2)", parameters.reliable("gamma"), "gamma"),
    Conclusion("v.2b", "γ can be increased without instability",
               "Co-design takes a higher γ than MaxRel and gains by it", parameters.heading_pays, "gamma"),
    Conclusion("vi.1", "inflates safety margins with age-of-information", "c_miss keeps robots apart under drops",
               parameters.margins, "c_miss"),
    Conclusion("vi.2", "larger values are beneficial under packet drops", "A larger c_miss lowers AUC under drops",
               parameters.under_drops, "c_miss"),
    Conclusion("vi.3", "become unnecessarily restrictive at high delays where the system is already sluggish",
               "A larger c_miss raises AUC at high delay", parameters.restrictive, "c_miss"),
    Conclusion("vi.4", "leading to a moderate co-design choice", "A moderate c_miss wins",
               parameters.moderate("c_miss"), "c_miss"),
    Conclusion("V.B", "RELIABLE QoS restores performance (51.5 % higher QoC)", "RELIABLE gains 51.5 %", _ROBOTS),
)  # fmt: skip

MODEL = (
    Conclusion("M.1", "", "A moderate ν^max wins", parameters.moderate("v_max"), "v_max"),
    Conclusion("M.2", "", "A moderate κ wins", parameters.moderate("kappa"), "kappa"),
    Conclusion("M.3", "", "A high γ helps when the loop is fast", parameters.fast_heading, "gamma"),
    Conclusion("S", "", "Co-design's choices (but for η) keep robots apart", policies.apart),
)  # fmt: skip

CONCLUSIONS = tuple(each for each in (*SENTENCES, *MODEL) if not isinstance(each.test, str))
