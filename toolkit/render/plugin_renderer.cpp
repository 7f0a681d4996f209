#include <palpate/registry.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include <palpate/renderer_plugin.h>
#include <palpate/result.h>
#include "toolkit/core/parallel.h"
#include "toolkit/core/plugin_module.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::render {
namespace {

constexpr const char* kRendererPrefix = "renderer-";
constexpr const char* kOptionsKey = "options";
constexpr std::size_t kPluginTextBytes = 1024;

using PluginTable = std::shared_ptr<const palpate_renderer_plugin>;

Result<PluginTable> load_renderer(const std::filesystem::path& file) {
  PALPATE_ASSIGN(PluginTable table,
                 load_plugin<palpate_renderer_plugin>(file, PALPATE_RENDERER_ENTRY, PALPATE_RENDERER_ABI));
  if (table->what == nullptr || table->create == nullptr || table->prepare == nullptr ||
      table->restart == nullptr || table->step == nullptr || table->destroy == nullptr)
    return not_of_this_version(file);
  return table;
}

/// A plug-in's text, or `otherwise` where it is empty.
std::string text_or(const std::array<char, kPluginTextBytes>& text, const char* otherwise) {
  const std::string words(text.begin(), std::find(text.begin(), text.end(), '\0'));
  return words.empty() ? otherwise : words;
}

class PluginRenderer final : public SceneFreeRenderer {
 public:
  PluginRenderer(std::string name, std::filesystem::path file, Options options)
      : name_(std::move(name)), file_(std::move(file)), options_(std::move(options)) {}
  ~PluginRenderer() override { destroy(); }

  [[nodiscard]] Result<PrepareReport> prepare(const SceneInput& scene,
                                              const PrepareContext& context) override;
  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    counters_ = {};
    now_s_ = t_s;
    table_->restart(renderer_, hip_mm.data(), t_s);
  }
  void release_contact(const Vec3& hip_mm) noexcept override {
    table_->restart(renderer_, hip_mm.data(), now_s_);
  }
  [[nodiscard]] Frame step(const Vec3& hip_mm, double t_s) noexcept override;
  [[nodiscard]] FrameCounters counters() const noexcept override { return counters_; }
  [[nodiscard]] Description describe() const override {
    return {name_, table_ != nullptr ? table_->what : "a plug-in", file_.string(),
            std::string(kUnbounded) + ": a plug-in's own", options_};
  }

 private:
  void destroy() noexcept {
    if (renderer_ != nullptr) table_->destroy(std::exchange(renderer_, nullptr));
  }

  std::string name_;
  std::filesystem::path file_;
  Options options_;
  PluginTable table_;
  void* renderer_ = nullptr;
  double force_limit_n_ = 0.0;
  double now_s_ = 0.0;
  FrameCounters counters_;
};

Result<PrepareReport> PluginRenderer::prepare(const SceneInput& scene, const PrepareContext& context) {
  const Stopwatch watch;
  if (scene.models.size() != 1)
    return Error{"a plug-in feels one model", "give a scene of one model", file_.string()};
  destroy();
  PALPATE_ASSIGN(table_, load_renderer(file_));
  std::array<char, kPluginTextBytes> text{};
  renderer_ = table_->create(options_.text(kOptionsKey).c_str(), text.data(), kPluginTextBytes);
  if (renderer_ == nullptr)
    return Error{text_or(text, "the plug-in makes no renderer"), "see the plug-in's own description",
                 file_.string()};
  const ModelInput& model = scene.models.front();
  std::vector<double> points, vertices;
  const auto append = [&](std::vector<double>& to, const Vec3& in_model) {
    const Vec3 p = model.world_from_model * in_model;
    to.insert(to.end(), p.data(), p.data() + 3);
  };
  points.reserve(3 * model.cloud->size());
  for (std::size_t i = 0; i < model.cloud->size(); ++i) append(points, model.cloud->point_mm(i));
  palpate_renderer_model given{};
  given.points_mm = points.data();
  given.points = model.cloud->size();
  if (model.original_mesh != nullptr && !model.original_mesh->empty()) {
    const geometry::TriangleMesh& mesh = *model.original_mesh;
    vertices.reserve(3 * mesh.vertices_mm.size());
    for (const Vec3& p : mesh.vertices_mm) append(vertices, p);
    given.vertices_mm = vertices.data();
    given.vertices = mesh.vertices_mm.size();
    given.triangles = mesh.triangles.front().data();
    given.triangle_count = mesh.triangles.size();
  }
  given.stiffness_n_per_mm = model.surface.stiffness_n_per_mm;
  given.force_limit_n = force_limit_n_ = scene.force_limit_n;
  given.threads = static_cast<std::uint32_t>(context.threads > 0 ? context.threads : available_threads());
  std::uint64_t bytes = 0;
  if (table_->prepare(renderer_, &given, &bytes, text.data(), kPluginTextBytes) != 0)
    return Error{text_or(text, "the plug-in does not prepare this model"),
                 "see the plug-in's own description", file_.string()};
  PrepareReport report;
  report.total_ms = watch.ms();
  report.phases = {{"plug-in", report.total_ms}};
  report.bytes = bytes;
  report.notes = {std::string(table_->what) + ". What it holds is as the plug-in says."};
  return report;
}

Frame PluginRenderer::step(const Vec3& hip_mm, double t_s) noexcept {
  ++counters_.frames;
  now_s_ = t_s;
  Frame frame;
  frame.god_object_mm = hip_mm;
  if (!hip_mm.allFinite()) {
    frame.status = FrameStatus::kNonFinite;
    return frame;
  }
  palpate_renderer_frame answer{};
  table_->step(renderer_, hip_mm.data(), t_s, &answer);
  frame.contact = answer.contact != 0;
  if (!frame.contact) return frame;
  // Values that are no numbers are passed on: stepping and scoring report them.
  frame.force_n = limited(Vec3(answer.force_n[0], answer.force_n[1], answer.force_n[2]), force_limit_n_);
  frame.god_object_mm = {answer.god_object_mm[0], answer.god_object_mm[1], answer.god_object_mm[2]};
  frame.model = 0;
  return frame;
}

}  // namespace

void register_plugin_renderers(Registry& registry) {
  for (const PluginFile& plugin : plugin_files(kRendererPrefix)) {
    if (registry.find(plugin.name) != nullptr) continue;
    RendererInfo info;
    info.name = plugin.name;
    info.summary = "a plug-in that was installed here";
    info.source = plugin.file.string();
    info.role = Role::kRival;
    info.options = {{kOptionsKey, OptionKind::kText, "", "handed to the plug-in as it is"}};
    info.make = [plugin](const Options& options) {
      return std::make_unique<PluginRenderer>(plugin.name, plugin.file, options);
    };
    registry.add(std::move(info));
  }
}

}  // namespace palpate::render
