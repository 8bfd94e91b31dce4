"""The paper's tables of one capture: every method and every choice, fitted, measured and set side by side."""
