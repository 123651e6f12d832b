"""The run log of a drive: ``run.mcap``, which grows a chunk a second and can be read up to wherever it was cut."""

from swathe.runlog.reader import RunLog
from swathe.runlog.verdict import Verdict, verify
from swathe.runlog.writer import LogHeader, RunLogWriter

__all__ = ["LogHeader", "RunLog", "RunLogWriter", "Verdict", "verify"]
