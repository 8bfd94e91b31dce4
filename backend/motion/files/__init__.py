"""Any pose or landmark file: which format it is, what it holds, and the motion that follows."""
