// Fuzzes files of prepared surfaces: an Error that names the file, or surfaces of which every look-up ends at
// a brick that is there. Checksums are not compared here, so that damage gets past them.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <string>

#include "tests/fuzz/must.h"
#include "toolkit/spline_sdf/surface_file.h"

namespace {

using palpate::must;

void look(const palpate::spline_sdf::BrickGrid& grid) {
  for (int i = 0; i < 64; ++i) {
    const double edge = grid.cube_edge() * 0.37;
    const palpate::Vec3 at(edge * (i % 4), edge * (i / 4 % 4), edge * (i / 16));
    const auto place = grid.find(at);
    must(place.brick == palpate::spline_sdf::BrickGrid::kNone || place.brick < grid.bricks.size());
    if (place.brick != palpate::spline_sdf::BrickGrid::kNone)
      must(grid.bricks[place.brick].piece <= grid.closed_components.size());
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const int file = ::memfd_create("fuzzed.palsurf", 0);
  must(file >= 0 && ::ftruncate(file, 0) == 0);
  must(::pwrite(file, data, size, 0) == static_cast<ssize_t>(size));
  const std::string path = "/proc/self/fd/" + std::to_string(file);
  const auto opened = palpate::spline_sdf::SurfaceFile::open(path);
  if (!opened) {
    must(opened.error().file == path && !opened.error().remedy.empty());
    return 0;
  }
  for (std::size_t level = 0; level < (*opened)->surfaces().size(); ++level) {
    look((*opened)->surfaces()[level].surface.grid);
    if (const auto whole = (*opened)->load(level)) look((*whole)->grid);
  }
  return 0;
}
