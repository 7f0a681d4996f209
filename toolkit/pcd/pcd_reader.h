// PCD files through PCL: ASCII, binary, binary_compressed, organised. A target of its own (palpate::pcd),
// because PCL's io library brings VTK.
#pragma once

#include "toolkit/io/read_model.h"

namespace palpate::pcd {

inline constexpr const char* kPcdExtension = "pcd";

/// Adds that extension. PCL sees a file only after our own check of its header against its size
/// (toolkit/io/pcd_header.h), and nothing it throws or prints leaves this module. PCD is in metres by PCL's
/// convention, unless ReadOptions::unit says otherwise. An organised cloud without holes keeps its raster;
/// one with holes loses it together with the points that are not finite.
void add_pcd_reader(io::Readers& readers);

}  // namespace palpate::pcd
