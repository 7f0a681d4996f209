// Fuzzes file readers under the name PALPATE_FUZZ_NAME: an Error or a valid model, in bounded memory.
#include <cstdint>
#include <cstdlib>

#include <palpate/read_model.h>
#include "toolkit/io/byte_source.h"

namespace {

void require(bool holds) {
  if (!holds) std::abort();
}

void check(const palpate::io::ReadModel& model) {
  const palpate::cloud::Cloud& cloud = model.cloud;
  require(!cloud.empty());
  require(cloud.y_mm.size() == cloud.size() && cloud.z_mm.size() == cloud.size());
  require(model.file_points == cloud.size() + model.non_finite);
  for (const palpate::cloud::Property& property : cloud.properties)
    require(property.values.size() == cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) require(palpate::is_finite(cloud.point_mm(i)));
  if (cloud.raster) require(std::size_t{cloud.raster->columns} * cloud.raster->rows == cloud.size());
  if (!model.mesh) return;
  require(model.mesh->vertices_mm.size() == cloud.size());
  require(!model.mesh->triangles.empty());
  for (const auto& triangle : model.mesh->triangles) {
    for (const std::uint32_t corner : triangle) require(corner < cloud.size());
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const palpate::io::Readers readers = [] {
    palpate::io::Readers all;
    palpate::io::add_standard_readers(all);
    return all;
  }();
  palpate::io::ReadOptions options;
  // Small, because fuzzers of the decompressors soon find bombs, each of which costs the bound.
  options.max_bytes = std::uint64_t{1} << 18;
  const auto bytes = std::as_bytes(std::span(data, size));
  const auto model =
      readers.read(std::make_unique<palpate::io::MemorySource>(bytes), PALPATE_FUZZ_NAME, options);
  if (model)
    check(*model);
  else
    require(!model.error().what.empty() && model.error().file == PALPATE_FUZZ_NAME);
  return 0;
}
