"""Arithmetic formulas of named variables, parsed into a syntax tree; no code is executed.

    "0.1*x*sin(2*pi*t)"

contains numbers, variables, `pi`, + - * / **, and the functions of `FUNCTIONS`. The values of the variables and the functions
are given at evaluation: numbers, arrays or CoefficientFunctions.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ngbrain.errors import InputError, nearest

FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "tanh": np.tanh,
    "min": np.minimum,
    "max": np.maximum,
}
"""Functions that a formula may call, for arrays; min and max take two arguments."""
TWO = ("min", "max")
"""Functions of two arguments."""
OPERATORS: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
LONGEST, LARGEST_POWER = 300, 20.0
"""Maximum number of characters, and maximum exponent; exponents must be constants."""


@dataclass(frozen=True)
class Formula:
    """An arithmetic formula of some variables.

    Parameters
    ----------
    text : str
        The formula.
    names : tuple of str
        Variables that it may contain.

    Raises
    ------
    InputError
        The text contains anything but arithmetic of these variables.

    Examples
    --------
    >>> f = Formula("2*x + min(t, 1)", ("x", "t"))
    >>> float(f({"x": 3.0, "t": 5.0})), sorted(f.variables)
    (7.0, ['t', 'x'])
    >>> Formula("__import__('os')", ("x",))
    Traceback (most recent call last):
    ngbrain.errors.InputError: formula is "__import__('os')"; wanted: one of sin, cos, tan, exp, log, sqrt, abs, tanh, min, max
    """

    text: str
    names: tuple[str, ...]
    _tree: ast.expr = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.text) > LONGEST:
            raise InputError("formula", f"of {len(self.text)} characters", f"at most {LONGEST}")
        try:
            object.__setattr__(self, "_tree", ast.parse(self.text.strip(), mode="eval").body)
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            self._refuse(f"a number, or a formula of {', '.join(self.names)} such as '{self.names[0]}**2/10'")
        self._check(self._tree)
        for node in ast.walk(self._tree):
            if isinstance(node, (ast.BinOp, ast.Call)) and not _variables(node):
                with np.errstate(all="ignore"):
                    try:
                        finite = np.isfinite(_value(node, {}, FUNCTIONS))
                    except ArithmeticError:
                        finite = False
                if not finite:
                    self._refuse(f"finite numbers, not {ast.unparse(node)}")

    def _refuse(self, wanted: str) -> None:
        raise InputError("formula", repr(self.text), wanted)

    def _check(self, node: ast.AST) -> None:
        if isinstance(node, ast.Constant):
            if type(node.value) not in (int, float) or not abs(node.value) <= 1e300:  # type: ignore[arg-type]
                self._refuse(f"numbers in the place of {node.value!r}")
        elif isinstance(node, ast.Name):
            if node.id not in (*self.names, "pi"):
                self._refuse(f"{nearest(node.id, [*self.names, 'pi'])}, not {node.id!r}")
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            name, wanted = node.func.id, 1 + (node.func.id in TWO)
            if name not in FUNCTIONS:
                self._refuse(f"one of {', '.join(FUNCTIONS)}")
            if len(node.args) != wanted:
                self._refuse(f"{name} of {wanted} argument{'s' * (wanted > 1)}, not {len(node.args)}")
            for each in node.args:
                self._check(each)
        elif isinstance(node, (ast.BinOp, ast.UnaryOp)) and type(node.op) in OPERATORS:
            for each in (node.left, node.right) if isinstance(node, ast.BinOp) else (node.operand,):
                self._check(each)
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
                # Checked before evaluation: towers of powers would take for ever.
                power = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
                if not isinstance(power, ast.Constant) or not abs(power.value) <= LARGEST_POWER:  # type: ignore[arg-type]
                    self._refuse(f"powers that are numbers up to {LARGEST_POWER:g}")
        else:
            self._refuse(f"arithmetic of {', '.join(self.names)} and numbers (powers are **)")

    @property
    def variables(self) -> set[str]:
        """Variables that occur in the formula."""
        return _variables(self._tree)

    def __call__(self, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]] = FUNCTIONS) -> Any:
        """Evaluate the formula.

        Parameters
        ----------
        values : mapping
            Values of the variables.
        functions : mapping, optional
            Functions for values of this type.

        Returns
        -------
        object
            Of the type of the values.
        """
        return _value(self._tree, values, functions)


def _variables(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - {"pi", *FUNCTIONS}


def _value(node: Any, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return math.pi if node.id == "pi" else values[node.id]
    if isinstance(node, ast.Call):
        return functions[node.func.id](*(_value(each, values, functions) for each in node.args))  # type: ignore[attr-defined]
    parts = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.operand,)
    return OPERATORS[type(node.op)](*(_value(each, values, functions) for each in parts))
