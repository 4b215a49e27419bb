"""How often what stands in a street: two towns that differ in their traffic, not in their materials or light."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Statistics:
    """Chances and shares that a street is drawn with."""

    parking: float = 0.65
    """Chance that cars park along the street."""
    parked: tuple[float, float] = (0.45, 0.9)
    """Share of the places that is taken, from and to."""
    urban: float = 0.5
    """Chance of tall houses without front gardens, and of many people."""
    ahead: float = 0.6
    """Chance of a vehicle in each gap of the car's own lane."""
    oncoming: float = 0.45
    """The same of the other lane."""
    trucks: float = 0.12
    """Share of trucks in the traffic."""
    bodies: tuple[float, ...] = (0.3, 0.2, 0.16, 0.2, 0.14)
    """Shares of hatchbacks, saloons, estates, SUVs and vans (in the order of CAR_SHAPES)."""


STATISTICS = {
    "town": Statistics(),
    "suburb": Statistics(
        parking=0.35,
        parked=(0.3, 0.7),
        urban=0.15,
        ahead=0.7,
        oncoming=0.6,
        trucks=0.2,
        bodies=(0.15, 0.3, 0.1, 0.35, 0.1),
    ),
}
"""By the name that `DataConfig.streets` takes."""
