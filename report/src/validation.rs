//! The published strokes at the default settings.
