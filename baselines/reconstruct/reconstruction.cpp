#include "baselines/reconstruct/reconstruction.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <ctime>

#include <palpate/result.h>
namespace palpate::baselines {
namespace {

// The fields of each document, for a writer of a constant one and for a reader.

template <class Stream, class Made>
void fields_of_reconstruction(Stream& stream, Made& r) {
  static_assert(sizeof r.peak_bytes == sizeof(std::uint64_t) && sizeof r.threads == sizeof(std::int32_t));
  stream(r.made_on);
  stream(r.peak_bytes);
  stream(r.threads);
  stream.list(r.made.phases, [](Stream& s, auto& phase) {
    s(phase.name);
    s(phase.ms);
  });
  stream.list(r.made.notes, [](Stream& s, auto& note) { s(note); });
  stream(r.mesh.vertices_mm);
  stream(r.mesh.triangles);
}

template <class Stream, class Points>
void fields_of_cloud(Stream& stream, Points& cloud) {
  for (int axis = 0; axis < 3; ++axis) stream(cloud.origin_mm[axis]);
  stream(cloud.x_mm);
  stream(cloud.y_mm);
  stream(cloud.z_mm);
  bool has_raster = cloud.raster.has_value();
  cloud::ScanRaster raster = cloud.raster.value_or(cloud::ScanRaster{});
  stream(has_raster);
  stream(raster.columns);
  stream(raster.rows);
  stream(raster.order);
  stream(raster.columns_wrap);
  stream(raster.rows_wrap);
  if constexpr (Stream::kReads)
    if (has_raster) cloud.raster = raster;
}

template <class Stream, class Failure>
void fields_of_error(Stream& stream, Failure& error) {
  stream(error.what);
  stream(error.remedy);
  stream(error.gave_up);
}

}  // namespace

void write(OutputArchive& to, const Reconstruction& from) {
  fields_of_reconstruction(to, from);
}

Result<Reconstruction> read_reconstruction(InputArchive& from) {
  Reconstruction r;
  fields_of_reconstruction(from, r);
  for (const render::PreparePhase& phase : r.made.phases) r.made.total_ms += phase.ms;
  r.made.bytes = r.mesh.bytes();
  const std::size_t vertices = r.mesh.vertices_mm.size();
  const bool in_range = std::all_of(r.mesh.triangles.begin(), r.mesh.triangles.end(), [&](const auto& t) {
    return t[0] < vertices && t[1] < vertices && t[2] < vertices;
  });
  if (!from.good() || !in_range) return Error{"these bytes are no reconstruction"};
  return r;
}

void write(OutputArchive& to, const cloud::Cloud& from) {
  fields_of_cloud(to, from);
}

Result<cloud::Cloud> read_cloud(InputArchive& from) {
  cloud::Cloud cloud;
  fields_of_cloud(from, cloud);
  const bool whole =
      from.good() && cloud.x_mm.size() == cloud.y_mm.size() && cloud.x_mm.size() == cloud.z_mm.size() &&
      (!cloud.raster || std::uint64_t{cloud.raster->columns} * cloud.raster->rows == cloud.size());
  if (!whole) return Error{"these bytes are no cloud"};
  return cloud;
}

void write(OutputArchive& to, const Error& from) {
  fields_of_error(to, from);
}

Error read_error(InputArchive& from) {
  Error error;
  fields_of_error(from, error);
  if (!from.good()) error.what = "the reconstruction failed without saying why";
  return error;
}

std::string now_text() {
  return fmt::format("{:%Y-%m-%d %H:%M} UTC", fmt::gmtime(std::time(nullptr)));
}

}  // namespace palpate::baselines
