#include "checker.hpp"

#include <algorithm>
#include <cmath>

namespace trailmark {
namespace {

constexpr std::size_t kMostTiles = 64;  // along each side

fcl::Transform3d pose(double x, double y, double cos, double sin) {
  fcl::Transform3d transform;
  transform.matrix() << cos, -sin, 0.0, x, sin, cos, 0.0, y, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0;
  return transform;
}

}  // namespace

Checker::Checker(const Problem& problem, bool plain)
    : bounds_{problem.bounds[0] - problem.tolerance, problem.bounds[1] - problem.tolerance,
              problem.bounds[2] + problem.tolerance, problem.bounds[3] + problem.tolerance},
      circumradius_(problem.robot.circumradius),
      round_(problem.robot.round),
      inscribed_(problem.robot.inscribed),
      centred_(inscribed_.center[0] == 0.0 && inscribed_.center[1] == 0.0),
      hull_(problem.robot.hull),
      polygons_(problem, plain ? 1 : kMostTiles) {
  if (!plain) {
    grid_.emplace(problem);
  }
  if (round_) {
    robot_ = std::make_shared<fcl::Sphered>(problem.robot.radius);
    robot_->computeLocalAABB();
  } else {
    robot_ = mesh_of(problem.robot.triangles);
  }
  if (!problem.discs.empty()) {
    // Spheres: exact against flat triangles and against one another.
    disc_manager_ = std::make_unique<fcl::DynamicAABBTreeCollisionManagerd>();
    for (const Disc& disc : problem.discs) {
      discs_.push_back(std::make_unique<fcl::CollisionObjectd>(std::make_shared<fcl::Sphered>(disc.radius),
                                                              pose(disc.center[0], disc.center[1], 1.0, 0.0)));
      disc_manager_->registerObject(discs_.back().get());
    }
    disc_manager_->setup();
  }
}

bool Checker::valid(double x, double y, double theta) const {
  checked_.store(checked_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  const bool inside = x - circumradius_ >= bounds_[0] && x + circumradius_ <= bounds_[2] &&
                      y - circumradius_ >= bounds_[1] && y + circumradius_ <= bounds_[3];
  if (round_ && !inside) {
    return false;
  }
  if (grid_) {
    if (inside && grid_->circumscribed_is_clear(x, y)) {
      return true;
    }
    if (centred_ && grid_->inscribed_hits(x, y)) {
      return false;
    }
  }
  const double cos = round_ ? 1.0 : std::cos(theta), sin = round_ ? 0.0 : std::sin(theta);
  if (!inside && !within_bounds(x, y, cos, sin)) {
    return false;
  }
  if (grid_) {
    if (grid_->circumscribed_is_clear(x, y)) {
      return true;
    }
    const auto [u, v] = inscribed_.center;
    if (!centred_ && grid_->inscribed_hits(x + cos * u - sin * v, y + sin * u + cos * v)) {
      return false;
    }
  }
  return !overlaps(x, y, cos, sin);
}

bool Checker::within_bounds(double x, double y, double cos, double sin) const {
  return std::all_of(hull_.begin(), hull_.end(), [&](const Point& p) {
    const double px = x + cos * p[0] - sin * p[1], py = y + sin * p[0] + cos * p[1];
    return px >= bounds_[0] && px <= bounds_[2] && py >= bounds_[1] && py <= bounds_[3];
  });
}

bool Checker::overlaps(double x, double y, double cos, double sin) const {
  const fcl::Transform3d robot = pose(x, y, cos, sin);
  if (const Mesh* polygons = polygons_.near(x, y)) {
    const fcl::CollisionRequestd request(1);
    fcl::CollisionResultd result;
    if (fcl::collide(robot_.get(), robot, polygons, fcl::Transform3d::Identity(), request, result) > 0) {
      return true;
    }
  }
  if (disc_manager_) {
    fcl::CollisionObjectd object(robot_, robot);
    fcl::DefaultCollisionData<double> data;
    disc_manager_->collide(&object, &data, fcl::DefaultCollisionFunction<double>);
    return data.result.isCollision();
  }
  return false;
}

}  // namespace trailmark
