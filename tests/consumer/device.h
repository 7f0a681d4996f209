// What the application does with a device.
#pragma once

#include <palpate/renderer.h>

/// Presses a simulated hand onto a surface whose place and outward normal are given; 0: it felt half a
/// newton.
int hold(palpate::render::HapticRenderer& renderer, const palpate::Vec3& surface_mm,
         const palpate::Vec3& normal);
