//! From spectra to what an eye or a screen sees.
