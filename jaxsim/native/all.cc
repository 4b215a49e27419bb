// All of it as one source: XLA's headers take longer to compile than the rest, and so are read once.

#include "convolve.cc"
#include "patches.cc"
#include "query.cc"
#include "tables.cc"
