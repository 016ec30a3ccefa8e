function [value, sd] = fit_tfest(t, u, position, detrended)
% FIT_TFEST  One pole and no zero in continuous time on the speed, which is the difference of the positions over the sample time.
%
%   The speed belongs to the middle of its sample time, so half of one is given as the delay. value = [K tau], sd from the toolbox's
%   covariance to first order. Not run under MATLAB; see run_peers.
sample_time = t(2) - t(1);
data = iddata(diff(position) / sample_time, u(2:end), sample_time, 'InterSample', 'zoh');
if detrended
    data = detrend(data, 0);
end
model = tfest(data, 1, 0, sample_time / 2);
[value, sd] = first_order(model);
end
