#include "experiments/streams/stream_facts.h"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "experiments/streams/open_stream.h"
#include "toolkit/stream/depth_source.h"

namespace palpate::experiments {
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
