// Points in pieces, by format; open_point_stream() (point_stream.h) chooses among them by a file's content.
// Errors name the file and what to do.
#pragma once

#include <memory>
#include <string>

#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/point_stream.h"

namespace palpate::io {

/// LAS, LAZ and COPC from any bytes. `threads` decode chunks; 0 is all of the machine's. `name` is for
/// messages.
[[nodiscard]] Result<std::unique_ptr<PointStream>> las_stream(std::unique_ptr<RandomAccess> file,
                                                              const std::string& name, int threads);
[[nodiscard]] Result<std::unique_ptr<PointStream>> open_e57_stream(const std::string& path);
[[nodiscard]] Result<std::unique_ptr<PointStream>> open_ptx_stream(const std::string& path);
[[nodiscard]] Result<std::unique_ptr<PointStream>> open_pts_stream(const std::string& path);

}  // namespace palpate::io
