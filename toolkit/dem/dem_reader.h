// Height grids through GDAL: GeoTIFF and plain TIFF, PNG of 16 bits, SRTM (.hgt, .hgt.zip), USGS DEM, ESRI
// ASCII grids (.asc). A target of its own (palpate::dem), because GDAL brings a hundred libraries.
#pragma once

#include "toolkit/io/read_model.h"

namespace palpate::dem {

/// What add_dem_readers() adds; zip: an SRTM tile in a ZIP archive.
inline constexpr const char* kDemExtensions[] = {"tif", "tiff", "png", "hgt", "dem", "asc", "zip"};

/// Adds them. Add it after
/// the standard readers: an .asc file that is no ESRI grid is still read as columns of numbers.
///
/// The points are the posts, row after row from the south, each from the west, the south-west one at (0, 0);
/// posts without data are points that are not finite, dropped with their count: holes. Posts are as far apart
/// as the file says; in degrees, as on the WGS 84 ellipsoid in the middle of the file, with a warning.
/// ReadOptions::post_mm and vertical_mm replace that and the heights' unit. GDAL sees a file from memory
/// only, after our own check of its header against its size (dem_check.h), with the drivers of these formats
/// and no network; nothing it prints leaves this module. Thread-safe.
void add_dem_readers(io::Readers& readers);

}  // namespace palpate::dem
