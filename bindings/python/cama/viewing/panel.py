# SPDX-License-Identifier: Apache-2.0
"""The parts of the control panel that recordings and simulations share: colours, legend, layers, facts."""

import html

import numpy as np

from . import colors
from .surface import PLAIN, QUANTITIES


class Panel:
    """Colours and layers.

    Args:
        server: The viser.ViserServer.
        surface: The Surface.
        page: The Page.
        changed: Called, from a thread of the server, after the user changed something that is seen.
    """

    def __init__(self, server, surface, page, changed):
        self._gui, self._surface, self._page, self._changed = server.gui, surface, page, changed
        self._ranges, self._fit = {}, False
        self.facts = self._gui.add_markdown("")
        self._add_colors()
        self._add_layers()

    def _add_colors(self):
        gui, page = self._gui, self._page
        with gui.add_folder("Colours"):
            self._quantity = gui.add_dropdown("colour by", tuple(QUANTITIES), initial_value=PLAIN)
            self._legend = gui.add_html("", visible=False)
            self._low = gui.add_number("from", 0.0, visible=False)
            self._high = gui.add_number("to", 1.0, visible=False)
            fit = self._fit_button = gui.add_button("Fit the scale to this frame", visible=False)
            self._wireframe = gui.add_checkbox("wireframe", False)
            shadows = gui.add_checkbox("shadows", page.shadows, hint="off: faster, above all without a GPU")
        self._quantity.on_update(lambda _: self._changed())
        self._wireframe.on_update(lambda _: self._changed())
        shadows.on_update(lambda event: page.set_shadows(event.target.value))
        fit.on_click(lambda _: self._wants_fit())
        for box in (self._low, self._high):
            box.on_update(self._edited)

    def _wants_fit(self):
        self._fit = True
        self._changed()

    def _edited(self, event):
        if event.client is not None:  # a user, not this program
            self._ranges[self._quantity.value] = (float(self._low.value), float(self._high.value))
            self._changed()

    def _add_layers(self):
        self._layers = []
        with self._gui.add_folder("Layers"):
            for part in self._surface.parts:
                self._layers.append(self._gui.add_checkbox(part.name or "unnamed", True))
                self._layers[-1].on_update(lambda _: self._changed())

    def show(self, moment):
        """Shows a Moment with the colours and layers that are chosen."""
        quantity, page = self._quantity.value, self._page
        page.hidden = {index for index, box in enumerate(self._layers) if not box.value}
        page.wireframe = self._wireframe.value
        valued = quantity != PLAIN
        values = self._surface.values(quantity, moment) if valued else None
        if valued and (self._fit or quantity not in self._ranges):
            self._ranges[quantity] = self._range(quantity, values)
        self._fit = False
        low, high = self._ranges.get(quantity, (0.0, 1.0))
        page.show(moment, values, low, high)
        self._show_scale(valued, low, high)

    def _range(self, quantity, values):
        """From 0 to a round number that 99.5 % of the values are below; gaps: to as far as they are looked for."""
        if quantity == "gaps":
            return 0.0, self._surface.reach * QUANTITIES[quantity][2]
        if quantity == "contacts":
            return 0.0, max(1.0, float(np.ceil(values.max(initial=0))))
        return 0.0, colors.round_up(float(np.percentile(values, 99.5)) if len(values) else 0.0)

    def _show_scale(self, valued, low, high):
        for part in (self._legend, self._low, self._high, self._fit_button):
            part.visible = valued
        if not valued:
            return
        words, unit, _ = QUANTITIES[self._quantity.value]
        note = "" if self._quantity.value != "strain" or self._surface.rest_is_known else ", from the start"
        self._legend.content = colors.legend(words + note, low, high, unit)
        self._low.value, self._high.value = low, high


def facts_of(moment, more=()):
    """Returns Markdown: time, contacts, intersections and more rows (name, text)."""
    rows = [("time", f"{moment.time:.4f} s")]
    if moment.contacts is not None:
        rows.append(("contacts", f"{moment.contacts:,}"))
    if moment.intersections is not None:
        rows.append(("intersections", f"**{moment.intersections:,}**" if moment.intersections else "0"))
    return table_of([*more, *rows])


def text_of(text):
    """Returns Markdown that shows a text as it is, also in a table."""
    return html.escape(str(text)).replace("|", "\\|")


def table_of(rows, title=("", "")):
    """Returns a Markdown table of two columns."""
    return "\n".join([f"| {title[0]} | {title[1]} |", "|---|---|", *(f"| {name} | {text} |" for name, text in rows)])
