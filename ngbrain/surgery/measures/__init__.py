"""What is measured in a simulated retraction: forces, pressures, strain, injury.

- `dose_response`: What animals say on the probability of an infarct under a retractor: published counts, and the
  range they leave.
- `injury`: What a retraction does to tissue: strain, stress and their rate at points, and the dose of a pressure.
- `observer`: What is read off a body under a blade after every step: force, area, pressure, opening, balances.
- `perfusion`: What blood pressure leaves under a blade: the perfusion reserve of a patient whose pressures are given.
- `sampling`: Where tissue is sampled, and what is read there: stretches, stress, rate; statistics that single points
  do not decide.
"""

__all__ = ["dose_response", "injury", "observer", "perfusion", "sampling"]
