function [value, sd] = first_order(model)
% FIRST_ORDER  [K tau] of b/(s + a), and their standard deviations to first order from the covariance of (b, a).
b = model.Numerator(end);
a = model.Denominator(2);
value = [b / a, 1 / a];
covariance = getcov(model);
covariance = covariance(1:2, 1:2);
by = [1 / a, -b / a^2
      0,     -1 / a^2];
sd = sqrt(diag(by * covariance * by.')).';
end
