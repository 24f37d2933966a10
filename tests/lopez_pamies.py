"""A law that the package does not have: one class, and the line that gives it a name."""

from dataclasses import dataclass

from ngbrain.materials.base import Addable, check_positive
from ngbrain.materials.registry import MU, LawEntry, Parameter


@dataclass(frozen=True)
class LopezPamies(Addable):
    """W = 3^(1-a)/(2a) μ (I₁^a - 3^a); Neo-Hooke's with a = 1.

    Source: Lopez-Pamies 2010, 10.1016/j.crme.2009.12.007.
    """

    mu: float
    a: float

    def __post_init__(self) -> None:
        check_positive(self.mu, "LopezPamies.mu")

    @property
    def initial_modulus(self):
        return self.mu

    def energy(self, C):
        """W (Pa)."""
        first = C[0, 0] + C[1, 1] + C[2, 2]
        return 3 ** (1 - self.a) / (2 * self.a) * self.mu * (first**self.a - 3**self.a)


LINE = "LopezPamies", LawEntry(LopezPamies, (MU, Parameter("a", low=0.1, high=20.0)))
