# SPDX-License-Identifier: Apache-2.0
"""What `cama.io.render` draws pictures with: moments, camera, surfaces, look, stage and film."""
