# SPDX-License-Identifier: Apache-2.0
"""Files of a run: `recording` (frames.h5), `checkpoint` (checkpoint.h5), `summary` (summary.json), `render` (video)."""
