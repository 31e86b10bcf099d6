#include "checker.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "distance.hpp"

namespace trailmark {
namespace {

constexpr std::size_t kMostTiles = 64;   // along each side
constexpr double kEnough = 0.1;          // of the inscribed radius: clearance that need not be measured
constexpr double kMostDiscs = 32.0;       // of the cover
constexpr double kRounding = 1e-9;       // metres, of a distance that FCL measures

fcl::Transform3d pose(double x, double y, double cos, double sin) {
  fcl::Transform3d transform;
  transform.matrix() << cos, -sin, 0.0, x, sin, cos, 0.0, y, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0;
  return transform;
}

// What a manager of discs is asked for: the robot's distance from them. For each pair, FCL itself would fit boxes to a sphere.
struct FromDiscs {
  const fcl::CollisionObjectd& robot;
  const std::vector<Triangle>& triangles;  // none: a disc
  double least;
};

bool from_disc(fcl::CollisionObjectd* a, fcl::CollisionObjectd* b, void* data, double& least) {
  auto& asked = *static_cast<FromDiscs*>(data);
  const fcl::CollisionObjectd& disc = a == &asked.robot ? *b : *a;
  const fcl::Vector3d center = asked.robot.getRotation().transpose() * (disc.getTranslation() - asked.robot.getTranslation());
  const auto radius = [](const fcl::CollisionObjectd& object) {
    return static_cast<const fcl::Sphered*>(object.collisionGeometry().get())->radius;
  };
  double found = std::hypot(center[0], center[1]);
  if (asked.triangles.empty()) {
    found -= radius(asked.robot);
  } else {
    found = std::numeric_limits<double>::infinity();
    for (const Triangle& triangle : asked.triangles) {
      found = std::min(found, distance_of({center[0], center[1]}, triangle));
    }
  }
  asked.least = least = std::min(asked.least, found - radius(disc));
  return least <= 0.0;
}

// Discs along the longer side of the smallest upright rectangle around the robot, so many that they reach little beyond it.
std::vector<Disc> cover_of(const Robot& robot) {
  if (robot.round) {
    return {{{0.0, 0.0}, robot.circumradius}};
  }
  double low[2], high[2];
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const auto [least, most] = std::minmax_element(
        robot.hull.begin(), robot.hull.end(), [axis](const Point& p, const Point& q) { return p[axis] < q[axis]; });
    low[axis] = (*least)[axis];
    high[axis] = (*most)[axis];
  }
  const std::size_t along = high[0] - low[0] >= high[1] - low[1] ? 0 : 1, across = 1 - along;
  const double length = high[along] - low[along], width = high[across] - low[across];
  const double count = std::min(kMostDiscs, std::ceil(2.0 * length / width));
  std::vector<Disc> discs;
  for (double i = 0.5; i < count; i += 1.0) {
    Disc disc{{}, std::hypot(0.5 * length / count, 0.5 * width) * (1.0 + kRounding)};
    disc.center[along] = low[along] + length * i / count;
    disc.center[across] = 0.5 * (low[across] + high[across]);
    discs.push_back(disc);
  }
  return discs;
}

}  // namespace

Checker::Checker(const Problem& problem, Kind kind)
    : bounds_{problem.bounds[0] - problem.tolerance, problem.bounds[1] - problem.tolerance,
              problem.bounds[2] + problem.tolerance, problem.bounds[3] + problem.tolerance},
      circumradius_(problem.robot.circumradius),
      margin_(kind == Kind::kClearances ? circumradius_ : 0.0),
      round_(problem.robot.round),
      inscribed_(problem.robot.inscribed),
      centred_(inscribed_.center[0] == 0.0 && inscribed_.center[1] == 0.0),
      hull_(problem.robot.hull),
      cover_(cover_of(problem.robot)),
      triangles_(problem.robot.triangles),
      polygons_(problem, kind == Kind::kPlain ? 1 : kMostTiles, margin_) {
  if (kind != Kind::kPlain) {
    grid_.emplace(problem, kind == Kind::kClearances);
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
  if (!inside && from_bounds(x, y, cos, sin) < 0.0) {
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

double Checker::clearance(double x, double y, double theta) const {
  checked_.store(checked_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  const double cos = round_ ? 1.0 : std::cos(theta), sin = round_ ? 0.0 : std::sin(theta);
  const double inside = from_bounds(x, y, cos, sin);
  if (!(inside > 0.0)) {
    return -1.0;
  }
  const double disc = grid_->distance(x, y) - circumradius_;
  if (disc >= inscribed_.radius) {
    return std::min(inside, disc);
  }
  const auto [u, v] = inscribed_.center;
  if (grid_->inscribed_hits(x + cos * u - sin * v, y + sin * u + cos * v)) {
    return -1.0;
  }
  double covered = std::numeric_limits<double>::infinity();
  for (const Disc& part : cover_) {
    const auto [px, py] = part.center;
    covered = std::min(covered, grid_->distance(x + cos * px - sin * py, y + sin * px + cos * py) - part.radius);
  }
  if (covered < kEnough * inscribed_.radius) {
    covered = std::max(covered, from_obstacles(x, y, cos, sin));
  }
  return std::min(inside, covered);
}

// Distance from the bounds grown by the tolerance; below 0 outside them.
double Checker::from_bounds(double x, double y, double cos, double sin) const {
  const auto least = [this](double left, double bottom, double right, double top) {
    return std::min({left - bounds_[0], bottom - bounds_[1], bounds_[2] - right, bounds_[3] - top});
  };
  if (round_) {
    return least(x - circumradius_, y - circumradius_, x + circumradius_, y + circumradius_);
  }
  double found = std::numeric_limits<double>::infinity();
  for (const Point& p : hull_) {
    const double px = x + cos * p[0] - sin * p[1], py = y + sin * p[0] + cos * p[1];
    found = std::min(found, least(px, py, px, py));
  }
  return found;
}

// Distance from obstacles, `margin_` if the polygons are farther; 0 or less if they overlap.
double Checker::from_obstacles(double x, double y, double cos, double sin) const {
  const fcl::Transform3d robot = pose(x, y, cos, sin);
  double found = margin_;
  if (const Mesh* polygons = polygons_.near(x, y)) {
    const fcl::DistanceRequestd request;
    fcl::DistanceResultd result;
    found = std::min(found, fcl::distance(robot_.get(), robot, polygons, fcl::Transform3d::Identity(), request, result));
  }
  if (disc_manager_ && found > 0.0) {
    fcl::CollisionObjectd object(robot_, robot);
    FromDiscs data{object, triangles_, found};
    disc_manager_->distance(&object, &data, from_disc);
    found = data.least;
  }
  return found - kRounding;
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
