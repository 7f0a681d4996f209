// A mesh made from points, with what making it took; and how it is written down.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "baselines/reconstruct/byte_stream.h"
#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/render/renderer.h"

namespace palpate::baselines {

struct Reconstruction {
  geometry::TriangleMesh mesh;  ///< model frame, mm
  render::PrepareReport made;   ///< the phases as they were timed when it was made; `bytes` is the mesh's own
  std::size_t peak_bytes = 0;   ///< largest resident memory of the process that made it; 0: not known
  int threads = 0;              ///< it was allowed
  std::string made_on;          ///< date and time, UTC
  bool recorded = false;        ///< comes from the cache: its times are those of `made_on`
};

void write(ByteWriter& to, const Reconstruction& from);
/// An Error where the bytes are none, or an index leads nowhere.
[[nodiscard]] Result<Reconstruction> read_reconstruction(ByteReader& from);

/// Positions and raster; a cloud's properties do not shape its mesh.
void write(ByteWriter& to, const cloud::Cloud& from);
[[nodiscard]] Result<cloud::Cloud> read_cloud(ByteReader& from);

void write(ByteWriter& to, const Error& from);
[[nodiscard]] Error read_error(ByteReader& from);

/// "2026-01-31 12:00 UTC".
[[nodiscard]] std::string now_text();

}  // namespace palpate::baselines
