"""Clips end to end: files in, a layer for each frame out, resumable and in parallel."""

from blurmatte.clips.saving import ClipReport as ClipReport
from blurmatte.clips.saving import ClipRun as ClipRun
from blurmatte.clips.table import FrameRecord as FrameRecord
from blurmatte.motion.clip.workers import cluster_workers as cluster_workers
