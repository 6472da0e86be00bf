//! Arguments, progress, reports; alone prints and exits.
