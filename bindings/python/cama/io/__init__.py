# SPDX-License-Identifier: Apache-2.0
"""Files of a run: `recording` (frames.h5, written through `journal`), `checkpoint`, `summary`, `render` (video)."""
