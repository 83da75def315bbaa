# SPDX-License-Identifier: Apache-2.0
"""The page of `cama view`: recordings and live simulations in a browser, by viser.

quantities: what cloth is coloured by, as functions of arrays; colors: scale, bands and legend; surface: what is shown;
page: its meshes; panel: the parts of the control panel that both kinds share; viewer: the server and its thread;
player: recordings; live: simulations.
"""
