# SPDX-License-Identifier: Apache-2.0
"""How wrong a simulation is, what accuracy costs, and which options keep a budget.

`accuracy` has the measures (of `motion`, `surface` and `reference`), `tradeoff` measures a `grid` of options point by point (`point`) in
processes (`executor`) and `report` writes what came out, `tune` picks options. `cama.accuracy`, `cama.tradeoff` and `cama.tune` are these modules.
"""
