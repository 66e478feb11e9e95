"""L, the parts of the reblur: lens sampling, depth order, edges, the paper's own networks."""
