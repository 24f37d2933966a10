"""Virtual work of contacts and loads in symbolic form, with its derivatives with respect to parameters and state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from numbers import Real

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import Load
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.forward.contact.rigid import RigidContact, SelfContact, WallContact
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock, Scalar
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, StateView, Terms, acting, derivatives, differentiate, vector

Array = np.ndarray


class ContactForms:
    """Virtual work C(x; θ)[λ] of loads and of contacts with rigid bodies, at the body's state.

    With a force-controlled tool, a motion λ has one more entry, the tool's displacement. Self-contact is not included.

    Parameters
    ----------
    body : Problem
        The body.
    parts : dict of str to ParameterBlock
        Blocks of θ.
    loads : sequence of Load, optional
        Some of the loads; all by default.
    contacts : sequence of WallContact, optional
        Some of the contacts; all by default.

    Raises
    ------
    InputError
        Where the penalty or softness of a self-contact is not a number.
    """

    def __init__(
        self,
        body: Problem,
        parts: Mapping[str, ParameterBlock],
        loads: Sequence[Load] | None = None,
        contacts: Sequence[WallContact] | None = None,
    ) -> None:
        self._loads = body.loads if loads is None else loads
        self._contacts = body.contacts if contacts is None else contacts
        for contact in self._contacts:
            if isinstance(contact, SelfContact):
                for name in ("penalty", "softness"):
                    if not isinstance(found := getattr(contact, name), Real):
                        raise InputError(
                            f"SelfContact.{name}", type(found).__name__, "a number, for derivatives of a run"
                        )
        self._body, self._parts, self._motion = body, list(parts.values()), ngs.GridFunction(body.fes)
        self._view, self._tool_weight = StateView(body), ngs.Parameter(0.0)
        self._slopes = [part.gradient(self.weighted_work(), body.mesh) for part in self._parts]

    def work(self, virtual: Motion, *along: Motion) -> Terms:
        """C[virtual] of a virtual displacement and, for each further motion, its derivative along it."""
        at, numbers = self._view.perturb_state(self._body.gfu, (virtual, *along))
        stored, followers = acting(self._body, at, self._loads, self._contacts)
        return differentiate(derivatives(stored, numbers[0]) + followers, numbers[1:])

    def tool_force(self, *along: Motion) -> Terms:
        """Force on a force-controlled tool along its axis, or its derivative along motions; empty without such a tool."""
        if self._body.tool is None:
            return []
        at, numbers = self._view.perturb_state(self._body.gfu, along)
        travel = self._given.parameter
        driven = [each for each in self._contacts if isinstance(each, RigidContact) and each.travel is travel]
        return differentiate(derivatives(acting(self._body, at, [], driven)[0], travel), numbers)

    def weighted_work(self, *along: Motion) -> Terms:
        """C[λ] with the λ of `set_adjoint`, or its derivative along motions."""
        return self.work(self._motion, *along) + [term.times(self._tool_weight) for term in self.tool_force(*along)]

    def set_adjoint(self, motion: Array) -> None:
        """Set λ (ndof,), or (ndof + 1,) with a force-controlled tool."""
        n = self._body.fes.ndof
        self._motion.vec.FV().NumPy()[:] = motion[:n]
        self._tool_weight.Set(float(motion[n]) if len(motion) > n else 0.0)

    def parameter_gradient(self) -> Array:
        """C_θᵀ λ with the λ of `set_adjoint` (θ,)."""
        return np.concatenate([slope() for slope in self._slopes])

    def parameter_jacobian(self) -> sp.csr_array:
        """C_θ (ndof, θ), without the tool's equation."""
        return sp.csr_array(sp.hstack([columns() for columns in self._columns]))

    @cached_property
    def _columns(self) -> list[Callable[[], sp.csr_array]]:
        tested = self.work(self._body.fes.TestFunction())
        return [part.jacobian(self._body.fes, tested) for part in self._parts]

    def tool_column(self) -> Array:
        """Derivative of the nodal forces with respect to the tool's displacement (ndof,)."""
        return self._column()

    @cached_property
    def _column(self) -> Callable[[], Array]:
        tested = self.work(self._body.fes.TestFunction())
        return vector(self._body.fes, derivatives(tested, self._given.parameter))

    def tool_stiffness(self) -> float:
        """Derivative of the tool force with respect to the tool's displacement (N/m)."""
        return float(self._stiffness()[0])

    @cached_property
    def _stiffness(self) -> Callable[[], Array]:
        return Scalar(self._given.parameter).gradient(self.tool_force(), self._body.mesh)

    @property
    def _given(self) -> PrescribedForce:
        assert self._body.tool is not None
        return self._body.tool.prescribed

    def tool_force_state_gradient(self) -> Array:
        """Derivative of the tool force with respect to the state (ndof,)."""
        return self._tool_force_state_gradient()

    @cached_property
    def _tool_force_state_gradient(self) -> Callable[[], Array]:
        return vector(self._body.fes, self.tool_force(self._body.fes.TestFunction()))

    def tool_force_parameter_gradient(self) -> Array:
        """Derivative of the tool force with respect to the parameters (θ,)."""
        return np.concatenate([slope() for slope in self._tool_force_parameter_gradient])

    @cached_property
    def _tool_force_parameter_gradient(self) -> list[Callable[[], Array]]:
        return [part.gradient(self.tool_force(), self._body.mesh) for part in self._parts]
