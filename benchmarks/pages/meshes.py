"""Tables of the page on labels and meshes."""

from _pages import records
from _tables import Record, bullets, count, listing, name, number, percent, seconds, spread


def _mm(value: float) -> str:
    return f"{number(value)} mm"


def _degrees(value: float) -> str:
    return f"{number(value, 3)}°"


def behind() -> str:
    finest = min((r for r in records("head_mesh") if r["converged"]), key=lambda r: r["error_mm"])
    mine = min((r for r in records("head_mesh") if r["method"].startswith("ngbrain")), key=lambda r: r["error_mm"])
    plain = min((r for r in records("tissue_meshes") if r["method"] == "voxels in six"), key=lambda r: r["mean_mm"])
    first = next(
        r for r in records("tissue_meshes") if r["method"] == "ngbrain:lattice" and r["mean_mm"] < plain["mean_mm"]
    )
    worst = percent(abs(plain["volume_errors"]["white"]))
    best = f"{_mm(mine['error_mm'])} in {seconds(mine['cpu_s'])}"
    nearer = f"{_mm(first['mean_mm'])}) takes {seconds(first['cpu_s'])}"
    return bullets(
        [
            f"The finest surface of {name(finest['method'])} is {_mm(finest['error_mm'])} off in {seconds(finest['cpu_s'])},"
            f" ours at best {best}.",
            f"Voxels cut in six are made in {seconds(plain['cpu_s'])} and {_mm(plain['mean_mm'])} off (white matter's volume by"
            f" {worst}); a lattice that is nearer ({nearer}.",
        ]
    )


def hull() -> str:
    columns = {
        "method": ("method", name), "elements or voxels": ("size", str), "tetrahedra": ("n_tets", count),
        "surface off by": ("error_mm", _mm), "brain's volume": ("brain_volume_error", percent),
        "ventricles'": ("ventricle_volume_error", percent), "smallest dihedral": ("min_dihedral_deg", _degrees),
        "CPU time": ("cpu_s", seconds), "failed": ("reason", str),
    }  # fmt: skip
    return listing(records("head_mesh"), columns)


def routes() -> str:
    columns = {
        "route": ("method", name), "elements": ("size", str), "tetrahedra": ("n_tets", count),
        "interfaces off by": ("mean_mm", _mm), "95 %": ("p95_mm", _mm), "fluid": ("volume_errors.csf", percent),
        "grey": ("volume_errors.grey", percent), "white": ("volume_errors.white", percent),
        "ventricles": ("volume_errors.ventricles", percent), "smallest dihedral": ("min_dihedral_deg", _degrees),
        "radius ratio below one tenth": ("fraction_radius_ratio_below_0_1", percent), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing(records("tissue_meshes"), columns)


def _pressed() -> list[Record]:
    return [r for r in records("mesh_routes") if r.get("pressure_mmHg")]


def dent() -> str:
    columns = {
        "route": ("method", name), "elements": ("size_mm", _mm), "tetrahedra": ("n_tets", count), "unknowns": ("ndof", count),
        "pressure": ("pressure_mmHg", lambda p: f"{number(p, 3)} mmHg"), "off by": ("pressure_error", percent),
        "strain, 95 %": ("strain_p95", lambda s: number(s, 3)), "off by ": ("strain_error", percent),
        "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing(_pressed(), columns)


def dent_conclusion() -> str:
    def off(route: str, key: str) -> str:
        return spread((r[key] for r in _pressed() if r["method"] == f"ngbrain:{route}" and not r["reference"]), percent)

    conforming, lattice, hulls = (off(route, "pressure_error") for route in ("conforming", "lattice", "hull"))
    return (
        "For pressing, meshes that follow tissues scatter: what decides is which films of fluid lie under the dent. The pressure is"
        f" off by {conforming} on conforming ones and {lattice} on lattices; a hull, which knows the fluid of sulci only at its"
        f" quadrature points, comes down steadily, {hulls}."
    )


def _waves() -> list[Record]:
    return [r for r in records("mesh_routes") if r.get("wave_error") is not None]


def wave() -> str:
    columns = {
        "route": ("method", name), "elements": ("size_mm", _mm), "order": ("order", str), "unknowns": ("wave_ndof", count),
        "wave off by": ("wave_error", percent), "order three on the same mesh changes": ("wave_own", percent),
        "CPU time": ("wave_s", seconds),
    }  # fmt: skip
    return listing(_waves(), columns)


def wave_conclusion() -> str:
    found = [r for r in _waves() if r["wave_error"]]
    best = min((r for r in found if r["wave_error"] < 0.1), key=lambda r: r["wave_s"])
    return (
        f"Cheapest within {percent(0.1)} of the finest mesh is order {best['order']} on a {name(best['method']).split()[-1]} one of"
        f" {_mm(best['size_mm'])}: {percent(best['wave_error'])}, {seconds(best['wave_s'], 3)}."
    )
