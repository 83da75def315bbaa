# SPDX-License-Identifier: Apache-2.0
"""Files of a run: frames.h5 (`recording`), checkpoint.h5 (`checkpoint`), summary.json (`summary`), images and video (`render`)."""
