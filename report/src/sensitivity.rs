//! What the means of the published strokes are sensitive to.
