# SPDX-License-Identifier: Apache-2.0
"""Table, plots and page of a trade-off. Plots need matplotlib."""

import csv
import html
import io
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path

from ..errors import FileError
from ..hints import require
from ..io.summary import finite
from ..types import PathLike
from .grid import label, step_text
from .point import MEASURES
from .tradeoff import Tradeoff

# Measures that are drawn against time: name, title, logarithmic.
PANELS = (
    ("restart_rms_edges", "position error after {window:g} s, rms, edge lengths", True),
    ("surface_mean_edges", "mean surface distance at {end:g} s, edge lengths", True),
    ("energy_error", "energy error after {window:g} s, of the kinetic", True),
    ("strain_max", "largest principal strain", False),
    ("lost_motion", "motion cut by the commit, mean part", False),
)
COLORS = {"cpu": "#4c78a8", "opencl": "#e45756", "cuda": "#54a24b"}
MARKERS = {"mixed": "o", "double": "s", "single": "^"}


def precision_of(point):
    """What a point was computed in."""
    return point["settings"].get("precision", "double" if point["settings"].get("accuracy") == "paper" else "mixed")


def columns(points):
    """Names of a table's columns: what was run, then the measures."""
    varied = []
    for p in points:
        varied += [k for k in p["settings"] if k not in varied]
    return ["scene", "triangles", "backend", "device", *varied, "dt", *MEASURES, "at_floor", "front", "failed"]


def rows(results):
    """One dict a point of all results, for the table."""
    table = []
    for r in results:
        for i, p in enumerate(r.points):
            table.append(
                {
                    "scene": r.scene,
                    "triangles": p.get("triangles", r.triangles),
                    "backend": p["backend"],
                    "device": p.get("device_name") or r.facts["devices"][p["backend"]],
                    **p["settings"],
                    "dt": p.get("dt"),
                    **{m: p.get(m) for m in MEASURES},
                    "at_floor": p.get("at_floor"),
                    "front": i in r.fronts[p["backend"]],
                    "failed": p["failed"],
                }
            )
    return table


def csv_text(results):
    """The table; empty cells were not measured."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns([p for r in results for p in r.points]), restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows(results):
        writer.writerow({k: "" if v is None else v for k, v in row.items()})
    return out.getvalue()


def json_text(results):
    """Everything that was measured, and what the measures are."""
    value = {
        "measures": {k: {"unit": u, "is": t} for k, (u, t) in MEASURES.items()},
        "scenes": [
            {
                "scene": r.scene,
                "triangles": r.triangles,
                **r.facts,
                "fronts": r.fronts,
                "points": r.points,
            }
            for r in results
        ],
    }
    return json.dumps(_plain(value), indent=1, allow_nan=False) + "\n"


def _plain(value):
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    return finite(value)


def _matplotlib():
    require("the plots", "matplotlib")
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "cama", "font.size": 8})
    return plt


def figure(result):
    """A matplotlib figure: measures of PANELS against time per simulated second, with the front of each backend."""
    plt = _matplotlib()
    fig, grid = plt.subplots(2, 3, figsize=(12.5, 7.9), layout="constrained")
    axes = grid.ravel()
    samples = [t for t in result.reference.starts if t > 0] or [result.reference.window]
    for axis, (measure, title, logarithmic) in zip(axes, PANELS):
        _panel(axis, result, measure, logarithmic)
        axis.set_title(title.format(window=result.reference.window, end=samples[-1]), fontsize=8.5)
        axis.set_xlabel("ms per simulated second")
    _floor(axes[0], result)
    _spans(axes[5], result)
    for axis in axes:
        _ticks(axis)
    f = result.facts
    fig.suptitle(
        f"{result.scene}, {result.triangles:,} triangles: speed for accuracy\nReference: steps of "
        f"{step_text(f['reference_step'])} s, off itself by about "
        f"{f['uncertainty_edges']:.2g} edge lengths (rms); an edge is {1e3 * f['edge']:.3g} mm. "
        f"{len(result.points)} settings, "
        f"{sum(bool(p['failed']) for p in result.points)} failed.",
        fontsize=9,
    )
    fig.legend(handles=_handles(plt, result), loc="outside lower center", ncols=4, frameon=False, fontsize=7.5)
    return fig


def _ticks(axis):
    """At 1, 2, 5 on logarithmic axes, or 1 alone where those are many; plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for own in (axis.xaxis, axis.yaxis):
        if own.get_scale() == "log":
            low, high = sorted(own.get_view_interval())
            own.set_major_locator(LogLocator(subs=(1,) if high > 200 * low else (1, 2, 5)))
            own.set_minor_formatter(NullFormatter())
            own.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}" if value < 1e5 else f"{value:.0e}"))


def _panel(axis, result, measure, logarithmic):
    usable = [p for p in result.points if not p["failed"] and p.get("ms_per_second") and p.get(measure) is not None]
    logarithmic = logarithmic and any(p[measure] > 0 for p in usable)
    axis.set_xscale("log")
    if logarithmic:
        axis.set_yscale("log")
        usable = [p for p in usable if p[measure] > 0]
    for p in usable:
        paper, clean, color = (
            p["settings"].get("accuracy") == "paper",
            not p.get("intersections"),
            COLORS.get(p["backend"], "#777777"),
        )
        axis.plot(
            p["ms_per_second"],
            p[measure],
            "*" if paper else MARKERS.get(precision_of(p), "o"),
            ms=13 if paper else 5,
            mfc=color if clean else "white",
            mec="black" if paper and clean else color,
            mew=0.7 if clean else 1.2,
            alpha=0.95 if paper else 0.75,
            zorder=4 if paper else 3,
        )
    for backend in result.fronts if measure != "strain_max" else ():  # a strain is no error
        front = [result.points[i] for i in result.front(backend, "ms_per_second", measure)]
        front = [p for p in front if not logarithmic or p[measure] > 0]
        axis.step(
            [p["ms_per_second"] for p in front],
            [p[measure] for p in front],
            where="post",
            lw=1,
            alpha=0.8,
            color=COLORS.get(backend, "#777777"),
            zorder=2,
        )
        if measure == PANELS[0][0] and backend == next(iter(result.fronts)):
            named = []
            for p in front:
                place = math.log10(p["ms_per_second"]), math.log10(p[measure]) if logarithmic else 0
                if any(abs(place[0] - q[0]) < 0.2 and abs(place[1] - q[1]) < 0.05 for q in named):
                    continue
                named.append(place)
                axis.annotate(
                    short(p["settings"]),
                    (p["ms_per_second"], p[measure]),
                    xytext=(4, 4),
                    textcoords="offset points",
                    fontsize=6,
                )
    axis.grid(which="major", alpha=0.3)
    axis.set_axisbelow(True)
    axis.margins(0.1)
    axis.autoscale_view()
    if not logarithmic:
        axis.set_ylim(0, 1.1 * max([p[measure] for p in usable] + [1e-3]))
    if measure == "strain_max" and result.facts.get("strain_max") is not None:
        axis.set_ylim(0, max(axis.get_ylim()[1], 1.1 * result.facts["strain_max"]))
        axis.axhline(result.facts["strain_max"], color="#555555", ls="--", lw=0.8)
        axis.text(
            0.01,
            result.facts["strain_max"],
            " the reference",
            transform=axis.get_yaxis_transform(),
            fontsize=6,
            va="bottom",
            color="#555555",
        )


def short(settings):
    """A point's name on a plot."""
    words = (
        [f"{settings['accuracy']}"]
        if settings.get("accuracy", "production") != "production" or list(settings) == ["accuracy"]
        else []
    )
    for name, value in settings.items():
        if name == "time_step":
            words.append(step_text(value))
        elif name == "precision":
            words += [] if value == "mixed" else [value]
        elif name != "accuracy":
            words.append(f"{value:g}" if isinstance(value, float) else f"{name} {value}")
    return ", ".join(words) or "production"


def _floor(axis, result):
    floor = result.facts["uncertainty_edges"]
    low, high = axis.get_ylim()
    if axis.get_yscale() == "log" and floor > low / 3:
        axis.axhspan(min(low, floor / 1.5), floor, color="#999999", alpha=0.25, lw=0)
        axis.text(
            0.01,
            floor,
            " uncertainty of the reference",
            transform=axis.get_yaxis_transform(),
            fontsize=6,
            va="top",
            color="#555555",
        )
        axis.set_ylim(min(low, floor / 1.5), high)


def _spans(axis, result):
    """Times from the fastest to the most accurate point of every front."""
    found = [p["ms_per_second"] for p in result.points if p.get("ms_per_second") and not p["failed"]]
    if not found:
        axis.axis("off")
        return
    names = []
    for backend, front in result.fronts.items():
        own = [result.points[i]["ms_per_second"] for i in front]
        if own:
            axis.plot([min(own), max(own)], [len(names)] * 2, "-|", color=COLORS.get(backend, "#777777"), lw=3)
            names.append(f"front of {backend}, {result.triangles:,}")
    axis.set(
        xscale="log",
        yticks=range(len(names)),
        yticklabels=names,
        ylim=(len(names) - 0.5, -0.5),
        xlabel="ms per simulated second",
    )
    axis.tick_params(axis="y", labelsize=6.5)
    axis.set_title(
        "times, triangles",
        fontsize=8.5,
    )
    axis.grid(axis="x", alpha=0.3)


def _handles(plt, result):
    line, handles = plt.Line2D, []
    for backend in result.fronts:
        handles.append(
            line(
                [],
                [],
                ls="-",
                marker="o",
                ms=5,
                lw=1,
                color=COLORS.get(backend, "#777777"),
                label=f"{backend} and its front ({result.facts['devices'][backend]})",
            )
        )
    for precision in dict.fromkeys(precision_of(p) for p in result.points):
        handles.append(
            line([], [], ls="", marker=MARKERS.get(precision, "o"), color="#777777", label=f"precision {precision}")
        )
    if any(p["settings"].get("accuracy") == "paper" for p in result.points):
        handles.append(line([], [], ls="", marker="*", color="white", mec="black", ms=12, label="the paper's settings"))
    if any(p.get("intersections") for p in result.points):
        handles.append(
            line(
                [], [], ls="", marker="o", color="white", mec="#777777", label="hollow: left intersections, on no front"
            )
        )
    return handles


def svg_text(fig):
    """The figure as SVG without prolog, references or dates."""
    out = io.StringIO()
    fig.savefig(out, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


STYLE = """body{font:14px/1.45 system-ui,sans-serif;margin:2em auto;max-width:78em;padding:0 1em;color:#222}
table{border-collapse:collapse;font-size:12px}
td,th{padding:3px 8px;border-bottom:1px solid #ddd;text-align:right;white-space:nowrap}
th{cursor:pointer;position:sticky;top:0;background:#fff}
td:first-child,th:first-child{text-align:left}tr.front{background:#eef6ee}tr.failed{color:#a33}.wide{overflow-x:auto}
svg{max-width:100%;height:auto}"""
SCRIPT = """for(const t of document.querySelectorAll("table"))
t.querySelectorAll("th").forEach((h,i)=>h.onclick=()=>{const b=t.tBodies[0],u=h.dataset.up!=="1";
h.dataset.up=u?"1":"0";const v=r=>{const x=r.cells[i].dataset.v;return x===undefined||x===""?null:isNaN(x)?x:+x};
[...b.rows].sort((p,q)=>{const x=v(p),y=v(q);if(x===null||y===null)return(x===null)-(y===null);
return(x<y?-1:x>y?1:0)*(u?1:-1)}).forEach(r=>b.append(r))})"""
SHOWN = (
    "ms_per_second",
    "restart_rms_edges",
    "restart_max_edges",
    "surface_mean_edges",
    "energy_error",
    "momentum_error",
    "strain_error",
    "strain_max",
    "strain_p999",
    "min_gap",
    "intersections",
    "lost_motion",
    "truncated",
    "residual",
    "nonlinear_residual",
    "iterations",
    "contacts",
)


def html_text(results, figures):
    """One page without any reference to elsewhere: figures (SVG texts), tables that sort by a click, what every column
    is.
    """
    parts = [
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>cama: speed for accuracy</title><style>',
        STYLE,
        "</style></head><body>",
        "<h1>Speed for accuracy</h1>",
    ]
    for r, svg in zip(results, figures):
        f = r.facts
        devices = "; ".join(f"{b}: {d}" for b, d in f["devices"].items())
        parts.append(
            f"<h2>{html.escape(r.scene)}, {r.triangles:,} triangles</h2><p>{html.escape(devices)}; cama "
            f"{html.escape(f['version'])}. "
            f"Errors after windows of {f['window']:g} s; the reference took steps of "
            f"{step_text(f['reference_step'])} s and may be off by "
            f"{f['uncertainty_edges']:.2g} edge lengths itself "
            f"({'converged' if f['converged'] else 'not converged'}).</p>{svg}"
        )
        parts.append(
            '<div class="wide"><table><thead><tr><th>settings</th><th>backend</th>'
            + "".join(_title(m, *MEASURES[m]) for m in SHOWN)
            + "</tr></thead><tbody>"
        )
        for i, p in enumerate(r.points):
            kind = "failed" if p["failed"] else "front" if i in r.fronts[p["backend"]] else ""
            name = html.escape(p["label"] + (f": {p['failed']}" if p["failed"] else ""))
            parts.append(
                f'<tr class="{kind}"><td data-v="{name}">{name}</td><td data-v="{p["backend"]}">{p["backend"]}</td>'
                + "".join(_cell(p.get(m)) for m in SHOWN)
                + "</tr>"
            )
        parts.append("</tbody></table></div>")
    parts += [
        "<h2>Columns</h2><ul>",
        *(f"<li><b>{m}</b> ({html.escape(u)}): {html.escape(t)}</li>" for m, (u, t) in MEASURES.items()),
        "</ul><p>Green rows are on the front of ms_per_second and restart_rms_edges of their backend; rows "
        "with intersections are never on it.</p><script>",
        SCRIPT,
        "</script></body></html>\n",
    ]
    return "".join(parts)


def _title(measure, unit, text):
    return f'<th title="{html.escape(text)}">{measure}{"" if unit == "1" else ", " + unit}</th>'


def _cell(value):
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "<td></td>"
    text = f"{value:,}" if isinstance(value, int) else f"{value:.4g}"
    return f'<td data-v="{value}">{text}</td>'


def file_names(results):
    """A name for the files of each result: its scene's, without what file names may not have, and numbered where it
    repeats.
    """
    names = []
    for r in results:
        plain = re.sub(r"[^\w.-]+", "_", r.scene).strip("._") or "scene"
        names.append(plain if plain not in names else f"{plain}-{len(names) + 1}")
    return names


def write(results: Sequence[Tradeoff], folder: PathLike, plots: bool = True) -> list[Path]:
    """Writes tradeoff.csv, tradeoff.json and, with plots, SCENE.svg, SCENE.png and index.html; returns their paths.

    Raises FileError, BackendError.
    """
    folder, written = Path(folder), []

    def put(name, text):
        (folder / name).write_text(text, encoding="utf-8")
        written.append(folder / name)

    try:
        folder.mkdir(parents=True, exist_ok=True)
        put("tradeoff.csv", csv_text(results))
        put("tradeoff.json", json_text(results))
        if plots:
            plt, svgs = _matplotlib(), []
            for r, name in zip(results, file_names(results)):
                fig = figure(r)
                svgs.append(svg_text(fig))
                put(f"{name}.svg", '<?xml version="1.0" encoding="utf-8"?>\n' + svgs[-1])
                fig.savefig(folder / f"{name}.png", dpi=110)
                written.append(folder / f"{name}.png")
                plt.close(fig)
            put("index.html", html_text(results, svgs))
    except OSError as problem:
        raise FileError(f"{folder}: {problem.strerror}") from None
    return written


def summary_rows(result):
    """(backend, label, ms per second, rms in edges, rms in mm) of every front, fastest first."""
    return [
        (
            b,
            label(result.points[i]["settings"]),
            result.points[i]["ms_per_second"],
            result.points[i]["restart_rms_edges"],
            1e3 * result.points[i]["restart_rms"],
        )
        for b, front in result.fronts.items()
        for i in front
    ]
