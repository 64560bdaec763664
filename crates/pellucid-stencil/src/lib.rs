//! The hierarchical descriptor of a surface point.
