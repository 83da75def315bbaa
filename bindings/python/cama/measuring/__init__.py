# SPDX-License-Identifier: Apache-2.0
"""Measurements: how accurate a simulation is, what accuracy costs, and which options keep a budget.

`accuracy` collects the measures of `motion`, `surface` and `reference`. `tradeoff` runs a `grid` of options, each a
`point`, in the processes of `executor`, and `report` writes tables and plots. `tune` picks options for a budget.
`cama.accuracy`, `cama.tradeoff` and `cama.tune` are the modules of these names.
"""
