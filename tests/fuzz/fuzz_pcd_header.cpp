// Fuzzes the check of PCD files before PCL: accepted headers must fit the file and memory.
#include <cstdint>
#include <cstdlib>

#include "toolkit/io/pcd_header.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  palpate::io::ReadOptions options;
  options.max_bytes = std::uint64_t{4} << 20;
  const auto file = std::as_bytes(std::span(data, size));
  const auto header = palpate::io::check_pcd(file, options);
  if (!header) {
    if (header.error().what.empty()) std::abort();
    return 0;
  }
  const std::uint64_t bytes = header->points() * header->point_bytes;
  bool sound = header->points() > 0 && header->body_at <= size && bytes <= options.max_bytes;
  if (header->data == palpate::io::PcdData::kBinary) sound = sound && header->body_at + bytes <= size;
  // The canonical header must parse to itself.
  std::string again = header->canonical;
  again.append(reinterpret_cast<const char*>(data) + header->body_at, size - header->body_at);
  const auto second = palpate::io::check_pcd(std::as_bytes(std::span(again)), options);
  sound = sound && second && second->points() == header->points() && second->canonical == header->canonical;
  if (!sound) std::abort();
  return 0;
}
