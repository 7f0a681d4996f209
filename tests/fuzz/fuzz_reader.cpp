// Fuzzes file readers under the name PALPATE_FUZZ_NAME: an Error or a valid model, in bounded memory.
#include <cstdint>

#include <palpate/read_model.h>
#include "tests/fuzz/must.h"
#include "toolkit/io/byte_source.h"

namespace {

using palpate::must;

void check(const palpate::io::ReadModel& model) {
  const palpate::cloud::Cloud& cloud = model.cloud;
  must(!cloud.empty());
  must(cloud.y_mm.size() == cloud.size() && cloud.z_mm.size() == cloud.size());
  must(model.file_points == cloud.size() + model.non_finite);
  for (const palpate::cloud::Property& property : cloud.properties)
    must(property.values.size() == cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) must(palpate::is_finite(cloud.point_mm(i)));
  if (cloud.raster) must(std::size_t{cloud.raster->columns} * cloud.raster->rows == cloud.size());
  if (!model.mesh) return;
  must(model.mesh->vertices_mm.size() == cloud.size());
  must(!model.mesh->triangles.empty());
  for (const auto& triangle : model.mesh->triangles) {
    for (const std::uint32_t corner : triangle) must(corner < cloud.size());
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
    must(!model.error().what.empty() && model.error().file == PALPATE_FUZZ_NAME);
  return 0;
}
