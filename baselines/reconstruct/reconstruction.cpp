#include "baselines/reconstruct/reconstruction.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <ctime>

namespace palpate::baselines {
namespace {

Error no_reconstruction() {
  return Error{"these bytes are no reconstruction", {}, {}, 0};
}

}  // namespace

void write(ByteWriter& to, const Reconstruction& from) {
  to.text(from.made_on);
  to.value(static_cast<std::uint64_t>(from.peak_bytes));
  to.value(static_cast<std::int32_t>(from.threads));
  to.value(static_cast<std::uint64_t>(from.made.phases.size()));
  for (const render::PreparePhase& phase : from.made.phases) {
    to.text(phase.name);
    to.value(phase.ms);
  }
  to.value(static_cast<std::uint64_t>(from.made.notes.size()));
  for (const std::string& note : from.made.notes) to.text(note);
  to.array(from.mesh.vertices_mm);
  to.array(from.mesh.triangles);
}

Result<Reconstruction> read_reconstruction(ByteReader& from) {
  Reconstruction r;
  r.made_on = from.text();
  r.peak_bytes = from.value<std::uint64_t>();
  r.threads = from.value<std::int32_t>();
  for (auto n = from.value<std::uint64_t>(); n > 0 && from.good(); --n) {
    render::PreparePhase phase;
    phase.name = from.text();
    phase.ms = from.value<double>();
    r.made.total_ms += phase.ms;
    r.made.phases.push_back(std::move(phase));
  }
  for (auto n = from.value<std::uint64_t>(); n > 0 && from.good(); --n) r.made.notes.push_back(from.text());
  r.mesh.vertices_mm = from.array<Vec3>();
  r.mesh.triangles = from.array<std::array<std::uint32_t, 3>>();
  r.made.bytes = r.mesh.bytes();
  if (!from.good()) return no_reconstruction();
  const std::size_t vertices = r.mesh.vertices_mm.size();
  const bool in_range = std::all_of(r.mesh.triangles.begin(), r.mesh.triangles.end(), [&](const auto& t) {
    return t[0] < vertices && t[1] < vertices && t[2] < vertices;
  });
  if (!in_range) return no_reconstruction();
  return r;
}

void write(ByteWriter& to, const cloud::Cloud& from) {
  for (const double c : {from.origin_mm.x(), from.origin_mm.y(), from.origin_mm.z()}) to.value(c);
  to.array(from.x_mm);
  to.array(from.y_mm);
  to.array(from.z_mm);
  to.value(static_cast<std::uint8_t>(from.raster.has_value()));
  const cloud::ScanRaster raster = from.raster.value_or(cloud::ScanRaster{});
  to.value(raster.columns);
  to.value(raster.rows);
  to.value(raster.order);
  to.value(static_cast<std::uint8_t>(raster.columns_wrap));
  to.value(static_cast<std::uint8_t>(raster.rows_wrap));
}

Result<cloud::Cloud> read_cloud(ByteReader& from) {
  cloud::Cloud cloud;
  for (int axis = 0; axis < 3; ++axis) cloud.origin_mm[axis] = from.value<double>();
  cloud.x_mm = from.array<float>();
  cloud.y_mm = from.array<float>();
  cloud.z_mm = from.array<float>();
  const bool has_raster = from.value<std::uint8_t>() != 0;
  cloud::ScanRaster raster;
  raster.columns = from.value<std::uint32_t>();
  raster.rows = from.value<std::uint32_t>();
  raster.order = from.value<cloud::ScanOrder>();
  raster.columns_wrap = from.value<std::uint8_t>() != 0;
  raster.rows_wrap = from.value<std::uint8_t>() != 0;
  if (has_raster) cloud.raster = raster;
  const bool whole = from.good() && cloud.x_mm.size() == cloud.y_mm.size() &&
                     cloud.x_mm.size() == cloud.z_mm.size() &&
                     (!has_raster || std::uint64_t{raster.columns} * raster.rows == cloud.size());
  if (!whole) return Error{"these bytes are no cloud", {}, {}, 0};
  return cloud;
}

void write(ByteWriter& to, const Error& from) {
  to.text(from.what);
  to.text(from.remedy);
  to.value(static_cast<std::uint8_t>(from.gave_up));
}

Error read_error(ByteReader& from) {
  Error error;
  error.what = from.text();
  error.remedy = from.text();
  error.gave_up = from.value<std::uint8_t>() != 0;
  if (!from.good()) error.what = "the reconstruction failed without saying why";
  return error;
}

std::string now_text() {
  return fmt::format("{:%Y-%m-%d %H:%M} UTC", fmt::gmtime(std::time(nullptr)));
}

}  // namespace palpate::baselines
