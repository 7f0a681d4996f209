// Bounds that the list of generators shares with what makes the models. Internal to cloud.
#pragma once

namespace palpate::cloud {

/// Indices of a mesh are 32 bits, and a hundred million points with their mesh fill a desktop's memory.
inline constexpr double kMostPoints = 1e8;

}  // namespace palpate::cloud
