#include "experiments/window/scene_view.h"

#include <epoxy/gl.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include <palpate/result.h>

namespace palpate::experiments {
namespace {

// Time for a picture's points: leaves some 25 pictures a second in software drawing, still smooth.
constexpr double kDrawMs = 25.0;
constexpr std::size_t kFewestPoints = 10'000, kFirstPoints = 50'000;
/// Largest growth of the budget per frame: one quick frame proves little.
constexpr double kMostGrowth = 2.0;
/// Weight of a new measurement in the mean time per point.
constexpr double kNewShare = 0.3;
/// Splat edges in pixels; near splats must cover the gaps between points.
constexpr double kSmallestSplat = 2.0, kLargestSplat = 200.0;
/// Size in pixels from which splats are drawn as discs, since squares become visible; discs cost more per
/// pixel.
constexpr double kDiscFrom = 8.0;
/// Splat edge over point distance: random samples are uneven, so neighbours must overlap.
constexpr double kOverlap = 2.8;
/// Share of the square around the scene's sphere that points fill, for surfaces at an angle.
constexpr double kFilledShare = 0.35;
/// Search distance for a point to each side, pixels.
constexpr int kSearchPx = 6;
/// Depths beyond this have no point.
constexpr float kNoDepth = 0.9999999f;
/// Background: blue grey against which ivory, green and red stand out.
constexpr std::array<float, 4> kPaper = {0.145f, 0.165f, 0.195f, 1.0f};

constexpr const char* kVertexShader = R"(#version 330 core
layout(location = 0) in vec3 place;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 colour;
uniform mat4 clip_from_model;
uniform mat3 world_from_model;
uniform vec3 to_light;
uniform vec3 to_eye;
uniform float size_px;
uniform float at_distance;
uniform float back;
uniform float lit;
flat out vec4 shown;
flat out vec4 facing;
void main() {
  gl_Position = clip_from_model * vec4(place, 1.0);
  gl_PointSize = clamp(size_px * at_distance / gl_Position.w, 1.0, 250.0);
  gl_Position.z += back * gl_Position.w;
  vec3 n = world_from_model * normal;
  float known = step(0.25, dot(n, n));
  n *= dot(n, to_eye) < 0.0 ? -1.0 : 1.0;
  float light = mix(1.0, 0.28 + 0.72 * max(0.0, dot(normalize(n + vec3(1e-6)), to_light)), known * lit);
  shown = vec4(colour.rgb * light, 1.0);
  facing = vec4(0.5 + 0.5 * n * known, known);
}
)";

constexpr const char* kFragmentShader = R"(#version 330 core
flat in vec4 shown;
flat in vec4 facing;
layout(location = 0) out vec4 colour;
layout(location = 1) out vec4 normal;
void main() {
  colour = shown;
  normal = facing;
}
)";

/// Visible splats are discs in their point's plane with depth per pixel, so neighbours meet where their
/// planes do. A disc seen flatter than acos(0.3) becomes no narrower, else gaps open.
constexpr const char* kDiscShader = R"(#version 330 core
uniform vec3 to_eye;
uniform vec3 to_right;
uniform vec3 to_up;
uniform float radius;
flat in vec4 shown;
flat in vec4 facing;
layout(location = 0) out vec4 colour;
layout(location = 1) out vec4 normal;
void main() {
  vec2 at = vec2(2.0, -2.0) * (gl_PointCoord - 0.5);
  vec3 n = (2.0 * facing.xyz - 1.0) * facing.w;
  float nearer = -(dot(n, to_right) * at.x + dot(n, to_up) * at.y) / max(dot(n, to_eye), 0.3);
  if (dot(at, at) + nearer * nearer > 1.0) discard;
  gl_FragDepth = gl_FragCoord.z - nearer * radius;
  colour = shown;
  normal = facing;
}
)";

Result<unsigned> compiled(unsigned kind, const char* source) {
  const unsigned shader = glCreateShader(kind);
  glShaderSource(shader, 1, &source, nullptr);
  glCompileShader(shader);
  int good = 0;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
  if (good == GL_TRUE) return shader;
  std::array<char, 512> words{};
  glGetShaderInfoLog(shader, static_cast<int>(words.size()), nullptr, words.data());
  glDeleteShader(shader);
  return Error{std::string("the graphics driver does not take a shader: ") + words.data(),
               "a driver with OpenGL 3.3 is needed; Mesa's software drawing has it"};
}

Result<unsigned> linked(const char* of_pixels) {
  PALPATE_ASSIGN(const unsigned vertex, compiled(GL_VERTEX_SHADER, kVertexShader));
  PALPATE_ASSIGN(const unsigned fragment, compiled(GL_FRAGMENT_SHADER, of_pixels));
  const unsigned program = glCreateProgram();
  glAttachShader(program, vertex);
  glAttachShader(program, fragment);
  glLinkProgram(program);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
  int good = 0;
  glGetProgramiv(program, GL_LINK_STATUS, &good);
  if (good == GL_TRUE) return program;
  glDeleteProgram(program);
  return Error{"the graphics driver does not link the shaders", "a driver with OpenGL 3.3 is needed"};
}

void set_matrix(unsigned program, const char* name, const Mat4& matrix) {
  const Eigen::Matrix4f as_float = matrix.cast<float>();
  glUniformMatrix4fv(glGetUniformLocation(program, name), 1, GL_FALSE, as_float.data());
}

void set_vector(unsigned program, const char* name, const Vec3& vector) {
  const Vec3f as_float = vector.cast<float>();
  glUniform3fv(glGetUniformLocation(program, name), 1, as_float.data());
}

void set_number(unsigned program, const char* name, double value) {
  glUniform1f(glGetUniformLocation(program, name), static_cast<float>(value));
}

Mat4 matrix_of(const geometry::RigidTransform& pose, const Vec3& origin_mm) {
  Mat4 matrix = Mat4::Identity();
  matrix.block<3, 3>(0, 0) = pose.rotation.toRotationMatrix();
  matrix.block<3, 1>(0, 3) = pose * origin_mm;
  return matrix;
}

template <class T>
void fill(unsigned buffer, std::span<const T> values) {
  glBindBuffer(GL_ARRAY_BUFFER, buffer);
  glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(values.size_bytes()), values.data(), GL_STATIC_DRAW);
}

}  // namespace

struct SplatDrawer::Model {
  unsigned array = 0, places = 0, normals = 0, colours = 0;
  std::size_t count = 0, drawn = 0;
  Vec3 origin_mm = Vec3::Zero();
  geometry::RigidTransform world_from_model;
};

/// The kept picture.
struct SplatDrawer::Target {
  unsigned frame = 0, colour = 0, normal = 0, depth = 0;

  ~Target() { drop(); }
  void drop() {
    glDeleteFramebuffers(1, &frame);
    const std::array<unsigned, 3> textures = {colour, normal, depth};
    glDeleteTextures(static_cast<int>(textures.size()), textures.data());
    frame = colour = normal = depth = 0;
  }
  static unsigned texture(int inner, unsigned format, unsigned type, int width, int height) {
    unsigned made = 0;
    glGenTextures(1, &made);
    glBindTexture(GL_TEXTURE_2D, made);
    glTexImage2D(GL_TEXTURE_2D, 0, inner, width, height, 0, format, type, nullptr);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return made;
  }
  bool make(int width, int height) {
    drop();
    colour = texture(GL_RGBA8, GL_RGBA, GL_UNSIGNED_BYTE, width, height);
    normal = texture(GL_RGBA8, GL_RGBA, GL_UNSIGNED_BYTE, width, height);
    depth = texture(GL_DEPTH_COMPONENT24, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT, width, height);
    glGenFramebuffers(1, &frame);
    glBindFramebuffer(GL_FRAMEBUFFER, frame);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, colour, 0);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT1, GL_TEXTURE_2D, normal, 0);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, depth, 0);
    const std::array<unsigned, 2> outputs = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
    glDrawBuffers(static_cast<int>(outputs.size()), outputs.data());
    return glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
  }
};

SplatDrawer::SplatDrawer() : target_(std::make_unique<Target>()), budget_(kFirstPoints) {}

SplatDrawer::~SplatDrawer() {
  clear();
  glDeleteProgram(squares_);
  glDeleteProgram(discs_);
}

Result<std::unique_ptr<SplatDrawer>> SplatDrawer::create() {
  std::unique_ptr<SplatDrawer> made(new SplatDrawer());
  PALPATE_TRY(made->build());
  return made;
}

Status SplatDrawer::build() {
  PALPATE_ASSIGN(squares_, linked(kFragmentShader));
  PALPATE_ASSIGN(discs_, linked(kDiscShader));
  return Done{};
}

void SplatDrawer::clear() {
  for (Model& model : models_) {
    glDeleteVertexArrays(1, &model.array);
    const std::array<unsigned, 3> buffers = {model.places, model.normals, model.colours};
    glDeleteBuffers(static_cast<int>(buffers.size()), buffers.data());
  }
  models_.clear();
  points_ = 0;
  stale_ = true;
}

std::size_t SplatDrawer::add(std::span<const float> places, std::span<const Rgba> colours,
                             const Vec3& origin_mm) {
  Model model;
  model.count = colours.size();
  model.origin_mm = origin_mm;
  glGenVertexArrays(1, &model.array);
  glBindVertexArray(model.array);
  std::array<unsigned, 3> buffers{};
  glGenBuffers(static_cast<int>(buffers.size()), buffers.data());
  model.places = buffers[0];
  model.normals = buffers[1];
  model.colours = buffers[2];
  fill(model.places, places);
  glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, nullptr);
  glEnableVertexAttribArray(0);
  glVertexAttrib3f(1, 0.0f, 0.0f, 0.0f);  // until normals are known
  fill(model.colours, colours);
  glVertexAttribPointer(2, 4, GL_UNSIGNED_BYTE, GL_TRUE, 0, nullptr);
  glEnableVertexAttribArray(2);
  points_ += model.count;
  models_.push_back(model);
  stale_ = true;
  return models_.size() - 1;
}

void SplatDrawer::replace(std::size_t model, std::span<const float> places, std::span<const Rgba> colours,
                          const Vec3& origin_mm) {
  Model& one = models_[model];
  points_ = points_ - one.count + colours.size();
  one.count = colours.size();
  one.origin_mm = origin_mm;
  fill(one.places, places);
  fill(one.colours, colours);
  set_normals(model, {});
}

void SplatDrawer::recolour(std::size_t model, std::span<const Rgba> colours) {
  fill(models_[model].colours, colours);
  stale_ = true;
}

void SplatDrawer::set_normals(std::size_t model, std::span<const PackedNormal> normals) {
  glBindVertexArray(models_[model].array);
  if (normals.empty()) {
    glDisableVertexAttribArray(1);
  } else {
    fill(models_[model].normals, normals);
    glVertexAttribPointer(1, 3, GL_BYTE, GL_TRUE, static_cast<int>(sizeof(PackedNormal)), nullptr);
    glEnableVertexAttribArray(1);
  }
  stale_ = true;
}

void SplatDrawer::move(std::size_t model, std::size_t index, const Vec3f& place_mm) {
  if (index >= models_[model].count) return;
  constexpr std::size_t kPlaceBytes = 3 * sizeof(float);
  glBindBuffer(GL_ARRAY_BUFFER, models_[model].places);
  glBufferSubData(GL_ARRAY_BUFFER, static_cast<GLintptr>(index * kPlaceBytes),
                  static_cast<GLsizeiptr>(kPlaceBytes), place_mm.data());
  stale_ = true;
}

void SplatDrawer::place(std::size_t model, const geometry::RigidTransform& world_from_model) {
  geometry::RigidTransform& now = models_[model].world_from_model;
  if (now.rotation.coeffs() == world_from_model.rotation.coeffs() &&
      now.translation_mm == world_from_model.translation_mm)
    return;
  now = world_from_model;
  stale_ = true;
}

void SplatDrawer::light(bool on) {
  stale_ = stale_ || lit_ != on;
  lit_ = on;
}

bool SplatDrawer::fit(int width_px, int height_px) {
  if (width_px == width_px_ && height_px == height_px_) return true;
  width_px_ = width_px;
  height_px_ = height_px;
  stale_ = true;
  return target_->make(width_px, height_px);
}

void SplatDrawer::begin() {
  constexpr std::array<float, 4> kNowhere = {0.0f, 0.0f, 0.0f, 0.0f};
  constexpr float kFarthest = 1.0f;
  glClearBufferfv(GL_COLOR, 0, kPaper.data());
  glClearBufferfv(GL_COLOR, 1, kNowhere.data());
  glClearBufferfv(GL_DEPTH, 0, &kFarthest);
  for (Model& model : models_) model.drawn = 0;
  drawn_ = 0;
  pictures_ = whole_after_ = 0;
  stale_ = false;
  ++begun_;
}

void SplatDrawer::draw(const Camera& camera, int width_px, int height_px) {
  last_drawn_ = 0;
  if (width_px <= 0 || height_px <= 0 || !fit(width_px, height_px)) return;
  stale_ = stale_ || !(camera == camera_);
  camera_ = camera;
  clip_from_world_ = camera.clip_from_world(width_px, height_px);
  glBindFramebuffer(GL_FRAMEBUFFER, target_->frame);
  glViewport(0, 0, width_px, height_px);
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_BLEND);
  glDepthMask(GL_TRUE);
  if (stale_) begin();
  ++pictures_;
  if (drawn_ < points_) draw_more();
  if (points_ > 0 && drawn_ == points_ && whole_after_ == 0) whole_after_ = pictures_;
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
}

void SplatDrawer::draw_more() {
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glEnable(GL_PROGRAM_POINT_SIZE);
  const double until = std::min(1.0, static_cast<double>(drawn_ + budget_) / static_cast<double>(points_));
  // The points drawn by the end of this frame share the scene's area.
  const double height = static_cast<double>(height_px_);
  const double wide_px = 2.0 * camera_.radius_mm() * camera_.pixels_per_mm(height);
  const double apart_px = wide_px * std::sqrt(kFilledShare / (until * static_cast<double>(points_)));
  const double size_px = std::clamp(kOverlap * apart_px, kSmallestSplat, kLargestSplat);
  // In depth-buffer units, 0 to 1.
  const double deep = size_px / camera_.pixels_per_mm(height) * camera_.depth_per_mm();
  const unsigned program = size_px < kDiscFrom ? squares_ : discs_;
  glUseProgram(program);
  set_number(program, "size_px", size_px);
  set_number(program, "at_distance", camera_.distance_mm());
  // Half the size further back, in units of -1 to 1.
  set_number(program, "back", deep);
  set_number(program, "radius", 0.5 * deep);
  set_number(program, "lit", lit_ ? 1.0 : 0.0);
  const Vec3 to_eye = -camera_.forward();
  set_vector(program, "to_eye", to_eye);
  set_vector(program, "to_right", camera_.right());
  set_vector(program, "to_up", camera_.up());
  set_vector(program, "to_light", (to_eye - 0.45 * camera_.right() + 0.6 * camera_.up()).normalized());
  for (Model& model : models_) {
    const auto end = static_cast<std::size_t>(std::ceil(until * static_cast<double>(model.count)));
    const std::size_t more = std::min(end, model.count) - model.drawn;
    const Mat4 world_from_model = matrix_of(model.world_from_model, model.origin_mm);
    set_matrix(program, "clip_from_model", clip_from_world_ * world_from_model);
    const Eigen::Matrix3f turn = world_from_model.block<3, 3>(0, 0).cast<float>();
    glUniformMatrix3fv(glGetUniformLocation(program, "world_from_model"), 1, GL_FALSE, turn.data());
    glBindVertexArray(model.array);
    glDrawArrays(GL_POINTS, static_cast<int>(model.drawn), static_cast<int>(more));
    model.drawn += more;
    drawn_ += more;
    last_drawn_ += more;
  }
  glDisable(GL_PROGRAM_POINT_SIZE);
  glDisable(GL_DEPTH_TEST);
}

void SplatDrawer::show() const {
  glBindFramebuffer(GL_READ_FRAMEBUFFER, target_->frame);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
  glReadBuffer(GL_COLOR_ATTACHMENT0);
  glBlitFramebuffer(0, 0, width_px_, height_px_, 0, 0, width_px_, height_px_, GL_COLOR_BUFFER_BIT,
                    GL_NEAREST);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
}

void SplatDrawer::took(double draw_ms) noexcept {
  if (last_drawn_ < kFewestPoints) return;
  const double now = draw_ms / static_cast<double>(last_drawn_);
  ms_a_point_ = ms_a_point_ > 0.0 ? (1.0 - kNewShare) * ms_a_point_ + kNewShare * now : now;
  const double fits = kDrawMs / ms_a_point_;
  const double most = kMostGrowth * static_cast<double>(budget_);
  budget_ = std::max(kFewestPoints, static_cast<std::size_t>(std::min(fits, most)));
}

std::optional<Hit> SplatDrawer::at(double x_px, double y_px) const {
  constexpr int kWide = 2 * kSearchPx + 1;
  const int left = static_cast<int>(x_px) - kSearchPx, top = static_cast<int>(y_px) - kSearchPx;
  if (drawn_ == 0 || left < 0 || top < 0 || left + kWide > width_px_ || top + kWide > height_px_)
    return std::nullopt;
  const int low = height_px_ - top - kWide;  // rows from the bottom
  std::array<float, static_cast<std::size_t>(kWide * kWide)> depth{};
  std::array<std::array<std::uint8_t, 4>, static_cast<std::size_t>(kWide * kWide)> normal{};
  glBindFramebuffer(GL_READ_FRAMEBUFFER, target_->frame);
  glReadPixels(left, low, kWide, kWide, GL_DEPTH_COMPONENT, GL_FLOAT, depth.data());
  glReadBuffer(GL_COLOR_ATTACHMENT1);
  glReadPixels(left, low, kWide, kWide, GL_RGBA, GL_UNSIGNED_BYTE, normal.data());
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  // Finds the covered pixel nearest to the place.
  int best = -1, best_sq = 2 * kWide * kWide;
  for (int row = 0; row < kWide; ++row)
    for (int column = 0; column < kWide; ++column) {
      const int index = row * kWide + column;
      const int dx = column - kSearchPx, dy = row - kSearchPx, sq = dx * dx + dy * dy;
      if (depth[static_cast<std::size_t>(index)] >= kNoDepth || sq >= best_sq) continue;
      best = index;
      best_sq = sq;
    }
  if (best < 0) return std::nullopt;
  Hit hit;
  hit.place_mm =
      unproject(clip_from_world_, {x_px, y_px, static_cast<double>(depth[static_cast<std::size_t>(best)])},
                width_px_, height_px_);
  const auto& packed = normal[static_cast<std::size_t>(best)];
  if (packed[3] != 0) {
    constexpr double kHalfByte = 127.5;
    for (int axis = 0; axis < 3; ++axis)
      hit.normal[axis] =
          (static_cast<double>(packed[static_cast<std::size_t>(axis)]) - kHalfByte) / kHalfByte;
    hit.normal = hit.normal.norm() > 0.0 ? Vec3(hit.normal.normalized()) : Vec3(Vec3::Zero());
  }
  return hit;
}

}  // namespace palpate::experiments
