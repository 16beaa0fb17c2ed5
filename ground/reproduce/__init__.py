"""The paper's campaign flown again, and every published number beside ours."""
