//! Every channel, known or not, to one run file.
