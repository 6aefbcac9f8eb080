"""Planning: container heightmap, candidates, scores, and the planner that joins them."""
