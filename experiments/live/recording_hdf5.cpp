#include "experiments/live/recording_session.h"

#ifndef PALPATE_WITH_HDF5

namespace palpate::experiments {

bool has_hdf5() {
  return false;
}
Result<std::uint64_t> export_hdf5(device::Recording& /*recording*/, const std::string& file,
                                  Progress& /*progress*/) {
  return Error{"this program was built without HDF5", "install libhdf5-dev and build again, or export csv",
               file};
}

}  // namespace palpate::experiments

#else

#include <hdf5.h>

#include <array>
#include <cstdio>
#include <memory>

#include <palpate/progress.h>
#include <palpate/result.h>

namespace palpate::experiments {
namespace {

// Rows per write and per chunk of the file: some 100 kB of a vector.
constexpr hsize_t kBlockRows = 4096;

/// Closes its handle; negative handles are none.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close)(hid_t)) noexcept : id_(id), close_(close) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&&) = delete;
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle() {
    if (id_ >= 0) close_(id_);
  }
  [[nodiscard]] hid_t id() const noexcept { return id_; }
  [[nodiscard]] bool good() const noexcept { return id_ >= 0; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

Error hdf5_error(const char* doing, const std::string& file) {
  return {std::string("cannot ") + doing + " the HDF5 file", "check the disk and its permissions", file, 0};
}

/// A dataset that grows by rows of `columns` numbers.
template <class T>
class Table {
 public:
  Table(hid_t parent, const char* name, hid_t file_type, hid_t memory_type, hsize_t columns)
      : columns_(columns), memory_type_(memory_type), data_(make(parent, name, file_type, columns)) {
    rows_.reserve(kBlockRows * columns);
  }
  void add(T value) { rows_.push_back(value); }
  void add(const Vec3& v) {
    for (int axis = 0; axis < 3; ++axis) rows_.push_back(static_cast<T>(v[axis]));
  }
  /// Writes full blocks, or everything if `all`. False on failure.
  [[nodiscard]] bool write(bool all) {
    const hsize_t rows = rows_.size() / columns_;
    if (rows == 0 || (!all && rows < kBlockRows)) return data_.good();
    const hsize_t size[2] = {written_ + rows, columns_}, at[2] = {written_, 0}, count[2] = {rows, columns_};
    const int rank = columns_ > 1 ? 2 : 1;
    if (!data_.good() || H5Dset_extent(data_.id(), size) < 0) return false;
    const Handle space(H5Dget_space(data_.id()), H5Sclose);
    const Handle memory(H5Screate_simple(rank, count, nullptr), H5Sclose);
    if (H5Sselect_hyperslab(space.id(), H5S_SELECT_SET, at, nullptr, count, nullptr) < 0 ||
        H5Dwrite(data_.id(), memory_type_, memory.id(), space.id(), H5P_DEFAULT, rows_.data()) < 0)
      return false;
    written_ += rows;
    rows_.clear();
    return true;
  }

 private:
  static Handle make(hid_t parent, const char* name, hid_t type, hsize_t columns) {
    const int rank = columns > 1 ? 2 : 1;
    const hsize_t none[2] = {0, columns}, most[2] = {H5S_UNLIMITED, columns},
                  block[2] = {kBlockRows, columns};
    const Handle space(H5Screate_simple(rank, none, most), H5Sclose);
    const Handle how(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    constexpr unsigned kQuick = 1;  // zlib level: most of the compression in a third of the time
    H5Pset_chunk(how.id(), rank, block);
    if (H5Zfilter_avail(H5Z_FILTER_DEFLATE) > 0) {
      H5Pset_shuffle(how.id());
      H5Pset_deflate(how.id(), kQuick);
    }
    return {H5Dcreate2(parent, name, type, space.id(), H5P_DEFAULT, how.id(), H5P_DEFAULT), H5Dclose};
  }
  hsize_t columns_;
  hid_t memory_type_;
  Handle data_;
  std::vector<T> rows_;
  hsize_t written_ = 0;
};

using Reals = Table<double>;
using Wholes = Table<std::int64_t>;

Reals reals(hid_t parent, const char* name, hsize_t columns = 1) {
  return {parent, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, columns};
}
Wholes wholes(hid_t parent, const char* name) {
  return {parent, name, H5T_STD_I64LE, H5T_NATIVE_INT64, 1};
}

bool put_text(hid_t object, const std::string& name, const std::string& text) {
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  // HDF5 has no zero-length strings: an empty text is one zero.
  H5Tset_size(type.id(), text.size() + 1);
  H5Tset_cset(type.id(), H5T_CSET_UTF8);
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  const Handle attribute(H5Acreate2(object, name.c_str(), type.id(), space.id(), H5P_DEFAULT, H5P_DEFAULT),
                         H5Aclose);
  return attribute.good() && H5Awrite(attribute.id(), type.id(), text.c_str()) >= 0;
}

bool put_reals(hid_t object, const char* name, std::span<const double> values) {
  const hsize_t size = values.size();
  const Handle space(H5Screate_simple(1, &size, nullptr), H5Sclose);
  const Handle attribute(H5Acreate2(object, name, H5T_IEEE_F64LE, space.id(), H5P_DEFAULT, H5P_DEFAULT),
                         H5Aclose);
  return attribute.good() && H5Awrite(attribute.id(), H5T_NATIVE_DOUBLE, values.data()) >= 0;
}

bool put_header(hid_t file, const device::RecordingHeader& h) {
  const Eigen::Quaterniond& q = h.world_from_device.rotation;
  const Vec3& t = h.world_from_device.translation_mm;
  const std::array<double, 7> pose = {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()};
  std::string decisions;
  for (const std::string& one : h.decisions) decisions += (decisions.empty() ? "" : "\n") + one;
  bool good = put_text(file, "format", "palpate-recording/1") && put_text(file, "program", h.program) &&
              put_text(file, "scene", h.scene) && put_text(file, "scene_hash", h.scene_hash) &&
              put_text(file, "device", h.device) && put_text(file, "mapping", h.mapping) &&
              put_text(file, "scheduling", h.scheduling) && put_text(file, "machine", h.machine) &&
              put_text(file, "started_utc", h.started_utc) && put_text(file, "decisions", decisions) &&
              put_reals(file, "rate_hz", std::span(&h.rate_hz, 1)) &&
              put_reals(file, "scale", std::span(&h.scale, 1)) &&
              put_reals(file, "world_from_device_wxyz_xyz_mm", pose);
  // Attributes hold 64 kB; a longer scene is left out.
  constexpr std::size_t kMostAttribute = 60'000;
  if (h.scene_text.size() < kMostAttribute) good = good && put_text(file, "scene_text", h.scene_text);
  return good;
}

/// One renderer's frames: a row per tick with a step; `tick` is its index.
struct RendererGroup {
  RendererGroup(hid_t file, const device::RecordedRenderer& renderer, std::size_t index)
      : group(H5Gcreate2(file, ("renderer_" + std::to_string(index)).c_str(), H5P_DEFAULT, H5P_DEFAULT,
                         H5P_DEFAULT),
              H5Gclose) {
    good = put_text(group.id(), "label", renderer.label) && put_text(group.id(), "name", renderer.name);
    for (const auto& [key, value] : renderer.options)
      good = good && put_text(group.id(), "option " + key, value);
  }
  void add(std::int64_t row, const device::RecordedTrack& track) {
    tick.add(row);
    force.add(track.frame.force_n);
    god_object.add(track.frame.god_object_mm);
    contact.add(track.frame.contact ? 1 : 0);
    model.add(track.frame.model);
    status.add(static_cast<std::int64_t>(track.frame.status));
    step.add(track.step_ns);
  }
  [[nodiscard]] bool write(bool all) {
    return good && tick.write(all) && force.write(all) && god_object.write(all) && contact.write(all) &&
           model.write(all) && status.write(all) && step.write(all);
  }
  Handle group;
  bool good = false;
  Wholes tick = wholes(group.id(), "tick");
  Reals force = reals(group.id(), "force_n", 3), god_object = reals(group.id(), "god_object_mm", 3);
  Wholes contact = wholes(group.id(), "contact"), model = wholes(group.id(), "model"),
         status = wholes(group.id(), "status"), step = wholes(group.id(), "step_ns");
};

/// Data of every tick.
struct TickTables {
  explicit TickTables(hid_t file) : at(file) {}
  void add(const device::RecordedTick& t) {
    time.add(t.t_s);
    t_ns.add(t.t_ns);
    late.add(t.late_ns);
    exchange.add(t.exchange_ns);
    packet.add(t.state.packet_ns);
    rearmed.add(t.rearmed ? 1 : 0);
    hip.add(t.hip_mm);
    device.add(t.state.position_mm);
    sent.add(t.sent_n);
    buttons.add(t.state.buttons);
    status.add(static_cast<std::int64_t>(t.state.status));
    fault.add(static_cast<std::int64_t>(t.fault));
    active.add(t.active);
    to.add(t.to);
    weight.add(t.weight);
    request.add(t.request);
    decision.add(t.decision);
    lost.add(static_cast<std::int64_t>(t.lost_before));
  }
  [[nodiscard]] bool write(bool all) {
    return time.write(all) && t_ns.write(all) && late.write(all) && exchange.write(all) &&
           packet.write(all) && rearmed.write(all) && hip.write(all) && device.write(all) &&
           sent.write(all) && buttons.write(all) && status.write(all) && fault.write(all) &&
           active.write(all) && to.write(all) && weight.write(all) && request.write(all) &&
           decision.write(all) && lost.write(all);
  }
  hid_t at;
  Reals time = reals(at, "t_s"), hip = reals(at, "hip_mm", 3), device = reals(at, "device_mm", 3),
        sent = reals(at, "sent_n", 3), weight = reals(at, "weight");
  Wholes t_ns = wholes(at, "t_ns"), late = wholes(at, "late_ns"), exchange = wholes(at, "exchange_ns"),
         packet = wholes(at, "packet_ns"), rearmed = wholes(at, "rearmed"), buttons = wholes(at, "buttons"),
         status = wholes(at, "device_status"), fault = wholes(at, "fault"), active = wholes(at, "active"),
         to = wholes(at, "to"), request = wholes(at, "request"), decision = wholes(at, "decision"),
         lost = wholes(at, "lost_before");
};

Result<std::uint64_t> write_hdf5(device::Recording& recording, const std::string& file, Progress& progress) {
  const Handle h5(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
  if (!h5.good()) return hdf5_error("create", file);
  if (!put_header(h5.id(), recording.header())) return hdf5_error("write", file);
  TickTables ticks(h5.id());
  std::vector<std::unique_ptr<RendererGroup> > groups;
  device::RecordedTick tick;
  std::int64_t rows = 0;
  for (;;) {
    PALPATE_ASSIGN(const bool more, recording.next(tick));
    while (groups.size() < recording.renderers().size())
      groups.push_back(
          std::make_unique<RendererGroup>(h5.id(), recording.renderers()[groups.size()], groups.size()));
    if (more) {
      ticks.add(tick);
      for (const device::RecordedTrack& track : tick.tracked())
        if (track.stepped) groups[track.renderer]->add(rows, track);
      ++rows;
    }
    bool good = ticks.write(!more);
    for (const std::unique_ptr<RendererGroup>& group : groups) good = good && group->write(!more);
    if (!good) return hdf5_error("write", file);
    if (!more) break;
    if (rows % static_cast<std::int64_t>(kBlockRows) == 0) progress.report("exporting", -1.0);
  }
  if (H5Fflush(h5.id(), H5F_SCOPE_GLOBAL) < 0) return hdf5_error("write", file);
  return static_cast<std::uint64_t>(rows);
}

}  // namespace

bool has_hdf5() {
  return true;
}

Result<std::uint64_t> export_hdf5(device::Recording& recording, const std::string& file, Progress& progress) {
  // Stops the library from printing its own errors.
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  const std::string part = file + ".part";
  const StopCallback stop_callback([part] {
    std::remove(part.c_str());
    return std::string();
  });
  Result<std::uint64_t> rows = write_hdf5(recording, part, progress);
  if (rows && std::rename(part.c_str(), file.c_str()) != 0) rows = hdf5_error("name", file);
  if (!rows) std::remove(part.c_str());
  return rows;
}

}  // namespace palpate::experiments

#endif
