"""Protocol execution: the engine, its boards, the sample pipeline, the runner and the client."""
