"""Case studies: real recordings of real rigs, diagnosed, scored beside rivals, told on a page each."""
