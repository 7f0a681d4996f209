#include "experiments/streams/open_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include <palpate/scene.h>
#include "device/record/recording.h"
#include "toolkit/render/depth_camera.h"
#include "toolkit/stream/depth_codec.h"
#include "toolkit/stream/depth_source.h"
#include "toolkit/stream/simulated_camera.h"

namespace palpate::experiments {
namespace {

/// Images in front of the first one that can be used: as many as a camera loses when it starts.
constexpr int kMostUnusable = 100;
/// Messages in one run: beyond, something else is wrong.
constexpr std::size_t kMostUnreadable = 1000;

/// Images of a recorded session in order, by their session's time.
class RecordedStream final : public stream::DepthSource {
 public:
  explicit RecordedStream(std::string file) : file_(std::move(file)) {}

  Status begin() {
    PALPATE_ASSIGN(device::Recording recording, device::Recording::open(file_));
    recording_.emplace(std::move(recording));
    PALPATE_ASSIGN(const bool any, recording_->next_depth(bytes_));
    if (!any)
      return Error{"holds no depth images: its session felt no stream",
                   "record one with palpate live --stream SOURCE --record FILE.palrec", file_};
    Result<stream::DepthCamera> camera = stream::decode_camera(bytes_);
    if (!camera) return std::move(camera).error().in_file(file_);
    camera_ = *camera;
    codec_.emplace(camera_);
    return Done{};
  }
  [[nodiscard]] const stream::DepthCamera& camera() const noexcept override { return camera_; }
  [[nodiscard]] Result<bool> next(stream::DepthFrame& frame) override {
    PALPATE_ASSIGN(const bool any, recording_->next_depth(bytes_));
    if (!any) return false;
    if (Status read = codec_->decode(bytes_, frame); !read) return std::move(read).error().in_file(file_);
    return true;
  }
  [[nodiscard]] Status restart() override { return begin(); }
  [[nodiscard]] std::string describe() const override { return "images of the recorded session " + file_; }

 private:
  std::string file_;
  std::optional<device::Recording> recording_;
  std::optional<stream::DepthCodec> codec_;
  stream::DepthCamera camera_;
  std::vector<std::byte> bytes_;
};

bool is_usable(const stream::DepthFrame& frame, const stream::DepthCamera& camera) {
  return render::FrameGate(camera.pixels()).judge(frame) == stream::FrameFate::kTaken &&
         std::any_of(frame.depth_mm.begin(), frame.depth_mm.end(), render::is_measured);
}

/// Whether the steps back through the lens arrive anywhere near, at the image's border, where it bends most.
bool can_undo_lens(const stream::DepthCamera& camera) {
  constexpr double kMostOff = 0.25;  // of the image's width
  constexpr int kAlong = 16;
  const auto is_found = [&](double u, double v) {
    const Vec3 ray = render::ray_of(camera, u, v);
    return is_finite(ray) &&
           (render::pixel_of(camera, ray) - Eigen::Vector2d(u, v)).norm() <= kMostOff * camera.width;
  };
  const double right = camera.width - 1, low = camera.height - 1;
  for (int i = 0; i <= kAlong; ++i) {
    const double u = right * i / kAlong, v = low * i / kAlong;
    if (!is_found(u, 0.0) || !is_found(u, low) || !is_found(0.0, v) || !is_found(right, v)) return false;
  }
  return true;
}

/// Scene of a simulated camera: a stock scene or a scene file. Models and motions are new in every call.
Result<stream::StockScene> simulated_scene(const std::string& name, const io::Readers& readers) {
  const std::string file = simulated_file(name);
  if (file.empty()) return stream::stock_scene(name);
  PALPATE_ASSIGN(const scene::SceneFile opened, scene::open_scene(file));
  PALPATE_ASSIGN(scene::LoadedScene loaded, scene::load(opened, readers, {}, no_progress()));
  return stream::camera_before(std::move(loaded.input), name.substr(name.find(file) + file.size()));
}

Result<std::unique_ptr<stream::DepthSource>> open_source(const std::string& name,
                                                         const io::Readers& readers) {
  if (device::is_recording(name)) {
    auto recorded = std::make_unique<RecordedStream>(name);
    PALPATE_TRY(recorded->begin());
    return std::unique_ptr<stream::DepthSource>(std::move(recorded));
  }
  if (name.starts_with(stream::kSimulatedPrefix)) {
    PALPATE_ASSIGN(stream::StockScene seen, simulated_scene(name, readers));
    return stream::simulated_camera_of(std::move(seen), name);
  }
  stream::DepthSourceOptions options;
  options.readers = &readers;
  return stream::open_depth_source(name, options);
}

}  // namespace

std::string simulated_file(const std::string& stream) {
  const std::string_view prefix = stream::kSimulatedPrefix;
  if (!stream.starts_with(prefix)) return {};
  const std::string file = stream.substr(prefix.size(), stream.find(':', prefix.size()) - prefix.size());
  return file.ends_with(".toml") ? file : std::string();
}

Result<OpenStream> open_stream(const std::string& name, const io::Readers& readers) {
  OpenStream open;
  open.name = name;
  std::error_code code;
  open.is_camera = stream::is_openni_name(name) && !std::filesystem::is_directory(name, code);
  PALPATE_ASSIGN(open.source, open_source(name, readers));
  if (name.starts_with(stream::kSimulatedPrefix)) {
    PALPATE_ASSIGN(stream::StockScene known, simulated_scene(name, readers));
    open.known = std::move(known);
  }
  if (!can_undo_lens(open.source->camera()))
    return Error{"the numbers of the camera's lens bend rays so much that no pixel's can be told",
                 "correct its distortion, k1 k2 p1 p2 k3", name};
  for (int i = 0; i < kMostUnusable; ++i) {
    const Result<bool> more = open.source->next(open.first);
    if (!more && open.is_camera) return more.error();  // it was waited for
    if (!more) {
      open.unreadable.push_back(more.error().message());
      continue;
    }
    if (!*more) break;
    if (!is_usable(open.first, open.source->camera())) continue;
    if (!open.known && !device::is_recording(name)) open.begun_s = open.first.captured_s;
    open.shift(open.first);
    return open;
  }
  Error none{"no image of this stream can be used", "give a stream of at least one depth image", name};
  if (!open.unreadable.empty()) none.what += ": " + open.unreadable.front();
  return none;
}

Result<cloud::Cloud> cloud_of(const stream::DepthFrame& frame, const stream::DepthCamera& camera) {
  const render::PixelRays rays(camera);
  std::vector<Vec3> points;
  points.reserve(frame.depth_mm.size());
  for (std::size_t i = 0; i < frame.depth_mm.size(); ++i)
    if (render::is_measured(frame.depth_mm[i]))
      points.push_back(frame.world_from_camera * (static_cast<double>(frame.depth_mm[i]) * rays.ray(i)));
  return cloud::build_cloud(points, cloud::NonFinite::kDrop);
}

Result<StreamFrames> load_frames(OpenStream& open, double until_s, Progress& progress) {
  StreamFrames all;
  all.source = open.name;
  all.about = open.source->describe();
  all.camera = open.source->camera();
  all.unreadable = open.unreadable;
  all.frames.push_back(open.first);
  const std::uint64_t frame_bytes = all.camera.pixels() * sizeof(float);
  stream::DepthFrame frame;
  for (;;) {
    const Result<bool> more = open.source->next(frame);
    if (progress.cancelled()) return Error{"stopped by the user"};
    if (!more) {
      if (all.unreadable.size() == kMostUnreadable) return more.error();
      all.unreadable.push_back(more.error().message());
      continue;
    }
    if (!*more) return all;
    open.shift(frame);
    if (frame.arrived_s > until_s) return all;
    if ((all.frames.size() + 1) * frame_bytes > kMostStreamBytes)
      return Error{
          fmt::format("its images up to {:.3g} s take more than {} bytes", until_s, kMostStreamBytes),
          "give a shorter path", open.name};
    all.frames.push_back(frame);
    progress.report("reading the stream",
                    until_s > 0.0 ? std::clamp(frame.arrived_s / until_s, 0.0, 1.0) : -1.0);
  }
}

namespace {

constexpr double kFactsMsPerS = 1e3, kFactsPercent = 100.0;
constexpr int kFactsIndent = 2;

std::string noise_text(double mm) {
  return mm > 0.0 ? fmt::format("{:.3g}", mm) : std::string("-");
}

}  // namespace

bool is_stream_name(const std::string& name) {
  std::error_code code;
  return std::filesystem::is_directory(name, code) || name.starts_with(stream::kSimulatedPrefix) ||
         stream::is_openni_name(name);
}

Result<StreamFacts> facts_of_stream(const std::string& name, const io::Readers& readers, Progress& progress) {
  PALPATE_ASSIGN(const OpenStream open, open_stream(name, readers));
  StreamFacts facts;
  facts.source = name;
  facts.about = open.source->describe();
  facts.camera = open.source->camera();
  PALPATE_TRY(open.source->restart());
  PALPATE_ASSIGN(facts.statistics, stream::measure_stream(*open.source, stream::kStatisticsFrames, progress));
  return facts;
}

std::string to_text(const StreamFacts& facts) {
  const stream::StreamStatistics& s = facts.statistics;
  const stream::DepthCamera& c = facts.camera;
  std::string text = facts.source + "\n";
  const auto row = [&](const char* key, const std::string& value) {
    text += fmt::format("  {:<18} {}\n", key, value);
  };
  row("stream", facts.about);
  row("images", s.frames_in_all > s.frames ? fmt::format("{} read of {}", s.frames, s.frames_in_all)
                                           : fmt::format("{}", s.frames));
  row("size", fmt::format("{} x {}", c.width, c.height));
  row("focal length", fmt::format("{:.5g} x {:.5g} px, middle {:.5g}, {:.5g}{}", c.fx_px, c.fy_px, c.cx_px,
                                  c.cy_px, c.distortion == decltype(c.distortion){} ? "" : "; distorted"));
  row("rate", fmt::format("{:.4g} Hz; {:.3f} ms of jitter", s.rate_hz, s.rate_jitter_s * kFactsMsPerS));
  row("light to arrival", fmt::format("{:.3g} ms; {:.3f} ms of jitter", s.latency_s * kFactsMsPerS,
                                      s.latency_jitter_s * kFactsMsPerS));
  row("holes", fmt::format("{:.3g} %, at most {:.3g} % of an image", s.holes * kFactsPercent,
                           s.most_holes * kFactsPercent));
  row("depths", fmt::format("{:.4g} to {:.4g} mm", s.nearest_mm, s.farthest_mm));
  row("noise", fmt::format("{:.3g} mm + {:.3g} mm at 1 m, by the square of the depth{}", s.noise_mm,
                           s.noise_per_mm * kFactsMsPerS * kFactsMsPerS,
                           s.moves ? "; the camera moves, so that it is of space alone" : ""));
  text +=
      fmt::format("  {:>10} {:>14} {:>12} {:>12}\n", "depth, mm", "over time, mm", "space, mm", "samples");
  for (const stream::NoiseAtDepth& one : s.noise)
    text += fmt::format("  {:>10.4g} {:>14} {:>12} {:>12}\n", one.depth_mm, noise_text(one.temporal_mm),
                        noise_text(one.spatial_mm), one.samples);
  for (const auto& [count, what] : {std::pair{s.lost, "missing by their numbers"},
                                    {s.out_of_order, "not later than the one before"},
                                    {s.other_size, "of another size"},
                                    {s.unreadable, "that cannot be read"}})
    if (count > 0) text += fmt::format("  warning: {} images {}\n", count, what);
  return text;
}

std::string to_json(const StreamFacts& facts) {
  const stream::StreamStatistics& s = facts.statistics;
  const stream::DepthCamera& c = facts.camera;
  nlohmann::ordered_json noise = nlohmann::ordered_json::array();
  for (const stream::NoiseAtDepth& one : s.noise)
    noise.push_back({{"depth_mm", one.depth_mm},
                     {"temporal_mm", one.temporal_mm},
                     {"spatial_mm", one.spatial_mm},
                     {"samples", one.samples}});
  const nlohmann::ordered_json json = {{"stream", facts.source},
                                       {"about", facts.about},
                                       {"frames", s.frames},
                                       {"frames_in_all", s.frames_in_all},
                                       {"width", c.width},
                                       {"height", c.height},
                                       {"focal_px", {c.fx_px, c.fy_px}},
                                       {"centre_px", {c.cx_px, c.cy_px}},
                                       {"distortion", c.distortion},
                                       {"rate_hz", s.rate_hz},
                                       {"rate_jitter_ms", s.rate_jitter_s * kFactsMsPerS},
                                       {"latency_ms", s.latency_s * kFactsMsPerS},
                                       {"latency_jitter_ms", s.latency_jitter_s * kFactsMsPerS},
                                       {"holes_percent", s.holes * kFactsPercent},
                                       {"most_holes_percent", s.most_holes * kFactsPercent},
                                       {"nearest_mm", s.nearest_mm},
                                       {"farthest_mm", s.farthest_mm},
                                       {"moves", s.moves},
                                       {"noise", std::move(noise)},
                                       {"noise_mm", s.noise_mm},
                                       {"noise_per_mm", s.noise_per_mm},
                                       {"lost", s.lost},
                                       {"out_of_order", s.out_of_order},
                                       {"other_size", s.other_size},
                                       {"unreadable", s.unreadable}};
  return json.dump(kFactsIndent, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace palpate::experiments
