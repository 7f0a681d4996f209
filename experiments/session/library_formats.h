// Formats that are read through GDAL and PCL, whose libraries are loaded when a file asks for them.
#pragma once

#include "toolkit/io/read_model.h"

namespace palpate::experiments {

/// Adds pcd, tif, tiff, png, hgt, dem, asc and zip, as far as they were built. The module palpate-formats.so
/// is looked for where the program's run path says and is loaded once, by the first file of these formats; an
/// Error of that file where it is not there. Thread-safe.
void add_library_formats(io::Readers& readers);

}  // namespace palpate::experiments
