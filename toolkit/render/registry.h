// The renderers by name. Explicit registration: an object, filled by each library's register function; no
// globals.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/render/capabilities.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

struct RendererInfo {
  std::string name;     ///< as in scene files and on the command line
  std::string summary;  ///< one line
  std::string source;   ///< thesis section or paper
  Role role = Role::kRival;
  Geometry geometry = Geometry::kPoints;  ///< kFormula: only for generated models
  Features supports;                      ///< what a scene may ask of it
  std::vector<OptionSpec> options;
  /// Makes an unprepared renderer. `options` is complete and validated.
  std::function<std::unique_ptr<HapticRenderer>(const Options& options)> make;
};

class Registry {
 public:
  /// A second renderer of the same name is a programming error (asserted).
  void add(RendererInfo info);
  [[nodiscard]] const std::vector<RendererInfo>& all() const noexcept { return renderers_; }
  [[nodiscard]] const RendererInfo* find(std::string_view name) const noexcept;
  /// Validates the options and makes the renderer. Unknown names get an error with the nearest known ones.
  [[nodiscard]] Result<std::unique_ptr<HapticRenderer>> make(std::string_view name,
                                                             const Options& options) const;
  /// An Error where the scene asks for what the renderer lacks: it says what, and which renderers have it.
  [[nodiscard]] Status check_supports(const RendererInfo& info, const SceneInput& scene) const;

 private:
  std::vector<RendererInfo> renderers_;
};

/// What the scene asks and this renderer leaves out, a sentence each for a person; nothing where it renders
/// all.
[[nodiscard]] std::vector<std::string> left_out(const RendererInfo& info, const SceneInput& scene);

}  // namespace palpate::render
