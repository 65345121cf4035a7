"""The answer of a study."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from manduca.views import Estimate, OptimumResult, Parameters, Scaled, ScaledEstimates


@dataclass(frozen=True)
class Optimum:
    """The stroke of least power in trim: the refined one where there is one, else as it was found."""

    name: str
    """Name of the optimisation."""
    parameters: Parameters
    """The ten parameters."""
    predicted: Scaled | None
    """L+, D+, M+, P+ foreseen there by the network."""
    simulated: ScaledEstimates | None
    """The same flown there, with standard errors; None before it is flown or where it cannot be."""
    power_per_lift_w_per_n: float | None
    """Simulated power per lift, W/N."""
    refined: bool
    """Whether simulations around the network's optimum have replaced it."""
    converged: bool
    """Whether refining ended because prediction and simulation agree."""
    trimmed_power: float | None
    """Simulated P+ corrected to exact trim: what refined optima are to be compared by."""
    result: OptimumResult
    """All the coordinator says, the network's own optimum, prices and other optima among it."""

    @classmethod
    def read(cls, result: OptimumResult) -> Optimum:
        """Read an optimum which is there."""
        search = result.get("refined") or {}
        standing = search.get("standing") or {}
        best = standing.get("best")
        found = best["parameters"] if best else result["parameters"]
        predicted, simulated = (
            (standing.get("predicted"), best.get("scaled"))
            if best
            else (result["predicted"], result["simulated"])
        )
        told = standing if best else result
        return cls(
            name=result["name"],
            parameters=cast("Parameters", found),
            predicted=predicted,
            simulated=simulated,
            power_per_lift_w_per_n=told.get("power_per_lift_w_per_n"),
            refined=best is not None,
            converged=bool(search.get("converged")),
            trimmed_power=standing.get("trimmed_power") if best else None,
            result=result,
        )

    def __str__(self) -> str:
        """Show a table for people."""
        how = "refined" if self.refined else "as found"
        lines = [f"{self.name}, {how}"]
        lines += [f"  {name:24}{value:11.4f}" for name, value in self.parameters.items()]
        lines.append(f"  {'':24}{'predicted':>11}   simulated")
        for symbol, output in (("L+", "lift"), ("D+", "drag"), ("M+", "pitch_moment"), ("P+", "power")):
            foreseen = f"{self.predicted[output]:11.4f}" if self.predicted else f"{'-':>11}"
            flown: Estimate | None = self.simulated[output] if self.simulated else None
            said = f"{flown['mean']:.4f} ± {flown['se']:.4f}" if flown else "-"
            lines.append(f"  {f'{symbol} {output}':24}{foreseen}   {said}")
        if self.power_per_lift_w_per_n is not None:
            lines.append(f"  {'P/L [W/N]':24}{'-':>11}   {self.power_per_lift_w_per_n:.3f}")
        lines += [f"  warning: {warning}" for warning in self.result.get("warnings", [])]
        if self.refined:
            said = "agree" if self.converged else "do not agree yet"
            lines.append(f"  prediction and simulation {said}")
        return "\n".join(lines)
