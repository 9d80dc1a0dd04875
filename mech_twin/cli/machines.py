# SPDX-License-Identifier: Apache-2.0
"""``mech-twin list``, ``new``, ``check``, ``export fmu``: machines, pages and units."""

import math
import sys
from pathlib import Path
from typing import Any

from mech_twin.cli.console import (
    CommandError,
    busy_bar,
    numbers_table,
    print_json,
    print_table,
    print_tables,
    say_result,
)
from mech_twin.cli.verbs import CheckVerb, FmuVerb, ListVerb, NewVerb
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.files.output_file import written_file
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.errors import described_keys
from mech_twin.parameters.load import (
    PAGE,
    PAGE_SUFFIXES,
    configuration_directories,
    is_page,
    machine_parameters,
)
from mech_twin.roles import own_name


def show_catalogue(request: ListVerb) -> None:
    """Print the names and titles of all machines."""
    titles = [(entry.name, entry.title) for entry in CATALOGUE.values()]
    if request.as_json:
        print_json({"machines": [{"name": name, "title": title} for name, title in titles]})
    else:
        print_table("machines", ("name", "description"), titles)


def shipped_pages() -> dict[str, Path]:
    """Return the pages that are installed, by kind."""
    found: dict[str, Path] = {}
    for directory in reversed(configuration_directories()):
        found |= {path.stem: path for path in sorted(directory.joinpath("pages").glob("*.yaml"))}
    return dict(sorted(found.items()))


def write_page(request: NewVerb) -> None:
    """Write a page to start from to standard output, or name the kinds."""
    kind, pages = request.kind, shipped_pages()
    if request.keys is not None:
        found = [row for row in described_keys(PAGE.parameters) if request.keys in ("all", row[0].partition(".")[0])]
        if not found:
            groups = ", ".join(PAGE.parameters.model_fields)
            raise CommandError(f"--keys {request.keys}: expected all or one of {groups}")
        print_table("keys of a page, NAME is yours", ("key", "unit", "description"), found, wide=True)
        return
    if kind is None:
        heads = {name: path.read_text(encoding="utf-8").splitlines()[0] for name, path in pages.items()}
        rows = [(name, head.lstrip("# ")) for name, head in heads.items()]
        print_table("pages to start from: mech-twin new KIND > my.yaml", ("kind", "what"), rows)
        return
    if kind not in pages:
        raise CommandError(f"no page '{kind}' to start from; expected one of {', '.join(pages)}")
    sys.stdout.write(pages[kind].read_text(encoding="utf-8"))


def check_page(request: CheckVerb) -> None:
    """Print a page's freedoms, closures, masses and start pose; draw it if asked."""
    page, picture = request.page, request.picture
    if not is_page(page):
        raise CommandError(f"{page}: expected the path of a page, ending in {' or '.join(PAGE_SUFFIXES)}")
    from mech_twin.machines.page.roles import PageModel

    parameters: Any = machine_parameters(page)
    try:
        model = PageModel(parameters.expanded)
        found = _page_record(model)
    except ConfigurationError as error:
        raise ConfigurationError(f"{page}: {error}") from error
    if picture is not None:
        _draw(model, picture)
    if request.as_json:
        print_json(found)
        return
    print_tables(numbers_table(f"{page}: {parameters.name}", found["numbers"]))
    rows = [(j["joint"], j["kind"], j["role"], *_as_on_page(j["start"], j["unit"])) for j in found["joints"]]
    print_table("joints at the start", ("joint", "kind", "moves as", "start", "unit"), rows)
    if found["contacts"]:
        gaps = [(c["contact"], c["state"], *_as_on_page(c["gap"], c["unit"])) for c in found["contacts"]]
        print_table("contacts at the start", ("contact", "state", "gap", "unit"), gaps)
    say_result(*found["remarks"])


def _as_on_page(value: float, unit: str) -> tuple[str, str]:
    """Return a length or an angle in the unit in which a page tells it."""
    return (f"{math.degrees(value):.6g}", "deg") if unit == "rad" else (f"{value:.6g}", unit)


def _page_record(shared: Any) -> dict[str, Any]:
    """Return the page's freedoms, closures, masses and start pose as plain values."""
    from mech_twin.machines.page import start_numbers
    from mech_twin.machines.page.drawing import real

    numbers, assembly, places = start_numbers(shared), shared.assembly, shared.places
    split, coordinates = assembly.split, assembly.coordinates
    roles = {coordinates[j]: "free" for j in split.free} | {coordinates[j]: "driven" for j in split.driven}
    roles |= {coordinates[j]: "dependent" for j in split.dependent}
    now = shared.start_instant
    motion = now.joint_motion()
    kinds = {name: joint.kind for name, joint in shared.page.joints.items()}
    joints = []
    for i, name in enumerate(assembly.columns):
        joint = next(own for own in kinds if name == own or (name.startswith(f"{own}_") and kinds[own] == "free"))
        found = {"joint": name, "kind": kinds[joint], "role": roles.get(name, "closes a loop")}
        joints.append(found | {"start": real(motion[2 * i]), "unit": "m" if name in assembly.slides else "rad"})
    contacts = []
    gaps = {name: law.scalar.value for name, law in zip(places.laws, now.laws, strict=True) if law.restitution >= 0.0}
    gaps |= {name: now.found_signals[name][0] for name in shared.page.contacts if name in now.found_signals}
    for name in (name for name in shared.page.contacts if name in gaps):  # a wall that gives way has none
        gap, unit = real(gaps[name]), "rad" if name in shared.turning_stops else "m"
        contacts.append({"contact": name, "state": "open" if gap > 1e-12 else "closed", "gap": gap, "unit": unit})
    masses = {name: body.mass_kg for name, body in shared.page.bodies.items()}
    remarks = [f"{name} has no mass" for name, mass in masses.items() if mass == 0.0]
    least = 1e-12 * shared.energy_scale_j / assembly.size_m  # less is rounding
    for name in shared.page.springs:
        size = real((now.conservative | now.actions)[name].efforts[0].size)
        size = size if abs(size) > least else 0.0
        remarks.append(f"{name} gives {size:.4g} {'N m' if shared.page.springs[name].turns else 'N'} at the start")
    head = {"page": shared.page.name, "numbers": numbers, "joints": joints, "contacts": contacts}
    return {**head, "masses_kg": masses, "remarks": remarks}


def _draw(model: Any, picture: Path) -> None:
    """Draw a page at its start."""
    from mech_twin.capabilities.plots import sheet
    from mech_twin.machines.page.drawing import PageDrawing, real

    motion = model.start_instant.joint_motion()
    places = {name: real(motion[2 * i]) for i, name in enumerate(model.assembly.columns)}
    shapes = PageDrawing(model).shapes_at(places)
    figure, (axes,) = sheet(1, 1, 8.0, 6.0)
    xs = [x for shape in shapes for x, _ in shape.points_m]
    ys = [y for shape in shapes for _, y in shape.points_m]
    reach = max(max(xs) - min(xs), max(ys) - min(ys), 1e-6)
    for shape in shapes:
        colour = tuple(part / 255.0 for part in shape.colour)
        points = list(zip(*shape.points_m, strict=True))
        width = max(0.6, 400.0 * shape.width_m / reach)
        if shape.kind == "points":
            axes.plot(*points, "o", color=colour, markersize=1.4 * width, zorder=3)
        else:
            axes.plot(*points, color=colour, linewidth=width, solid_capstyle="round")
        if shape.text:
            x, y = (0.5 * (min(part) + max(part)) for part in points)
            axes.annotate(shape.text, (x, y), textcoords="offset points", xytext=(6, 6), color=colour, fontsize=9)
    axes.set(aspect="equal", xlabel="x, m", ylabel="y, m")
    with written_file(picture, force=True) as unfinished:
        figure.savefig(unfinished)


def export_unit(request: FmuVerb) -> None:
    """Write the unit, and say what an importer sees of it."""
    from mech_twin.fmi.export import LINUX, WINDOWS, export_fmu

    built = request.built
    name, fmi = own_name(built.name, built.parameters), request.fmi
    file = request.out or Path(f"{name}.fmu")
    platforms = (LINUX, WINDOWS) if request.windows else (LINUX,)
    with busy_bar("compiling the unit"):
        written = export_fmu(built, file, fmi, platforms, force=request.force)
    if request.as_json:
        head = {"machine": name, "file": file, "fmi": fmi}
        head["platforms"] = [platform.folders[fmi - 2] for platform in platforms]
        sides = {f"{side}s": [v.name for v in written.variables if v.causality == side] for side in ("input", "output")}
        print_json({**head, **sides, "parameters": written.parameters})
        return
    outputs = sum(v.causality == "output" for v in written.variables)
    keys = ", ".join(v.name for v in written.variables if v.name.startswith(("parameters.", "live."))) or "none"
    say_result(f"{file}: FMI {fmi}.0 co-simulation of {name}, {outputs} outputs")
    say_result(f"configuration keys that an importer may set: {keys}; for others export anew with --set")
