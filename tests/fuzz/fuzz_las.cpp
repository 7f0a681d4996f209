// Fuzzes LAS and LAZ files: an Error with a remedy, or as many points as the header promises, in bounded
// memory.
#include <cstdint>
#include <cstdlib>

#include <palpate/progress.h>
#include "toolkit/io/las_header.h"
#include "toolkit/io/read_las.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const palpate::io::MemoryAccess file(std::as_bytes(std::span(data, size)));
  palpate::io::ReadOptions options;
  // Small: a few bytes of LAZ may be very many equal points, each of which costs time.
  options.max_bytes = std::uint64_t{1} << 20;
  const auto model = palpate::io::read_las(file, "a.laz", options, palpate::no_progress());
  if (!model) {
    if (model.error().what.empty() || model.error().remedy.empty()) std::abort();
    return 0;
  }
  const auto header = palpate::io::read_las_header(file);
  bool sound = header && model->points.size() == header->points;
  for (const auto& property : model->properties)
    sound = sound && property.values.size() == model->points.size();
  if (!sound) std::abort();
  return 0;
}
