"""The paper's experiments, run again and held against what it prints, and those that it leaves out."""
